"""A whole simulated inspection, from Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mission.flight.command import MissionState
from mission.remote.messages import EventMessage, StateMessage

if TYPE_CHECKING:
    from config.settings import Settings


@dataclass(frozen=True, slots=True)
class Simulated:
    """How a simulated inspection ended."""

    state: MissionState
    words: str
    folder: Path
    """The mission's folder: report, photos, recording."""
    mission: Mapping[str, object]
    """mission.json, with the truth of the simulated world (`truth`, `errors`)."""


def simulate(
    scenario: str | Path = "demo",
    *,
    seed: int | None = None,
    speed: float | None = None,
    out: str | Path = "missions",
    settings: Sequence[str] = (),
    on_state: Callable[[StateMessage], None] | None = None,
    on_event: Callable[[EventMessage], None] | None = None,
) -> Simulated:
    """Fly one inspection in simulation, as `bladescout simulate` does, and return how it ended.

    Args:
        scenario: A packaged one (`bladescout simulate --list`), or a TOML file.
        seed: Draws stop angle, pitch, yaw and launch point; None: as the scenario says.
        speed: Times real time; None: as fast as this computer can, 1 to 5.
        out: Where the mission's folder is made.
        settings: As after ``--set``: ``simulation.wind.mean_mps=7``.
        on_state: Called with every state, five a second, on the bus's thread.
        on_event: Called with every event, on the bus's thread.

    Raises:
        config.errors.ConfigError: A scenario or setting cannot be used.
        mission.processes.simulation.SimulationFailed: A part of it did not come up.
    """
    from mission.processes import simulation
    from mission.records.summary import add_truth

    outcome = simulation.simulate(
        _loaded(str(scenario), seed, speed, out, settings),
        on_state or (lambda _: None),
        on_event or (lambda _: None),
    )
    mission = add_truth(outcome.mission_dir, outcome.truth)
    return Simulated(outcome.state, outcome.words, outcome.mission_dir, mission)


def _loaded(
    scenario: str, seed: int | None, speed: float | None, out: str | Path, texts: Sequence[str]
) -> Settings:
    from config.sources import load_settings, scenario_path

    path = Path(scenario) if scenario.endswith(".toml") else scenario_path(scenario)
    own = {"seed": seed, "speed": speed}
    options = {
        name: f"simulation.{name}={value}" for name, value in own.items() if value is not None
    }
    return load_settings([path], texts, options=options | {"out": f"missions_dir={out}"})
