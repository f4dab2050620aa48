"""`bladescout simulate`: a whole inspection on this machine."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end, exit_of

if TYPE_CHECKING:
    from config.settings import Settings

_URLS = ("udpin://", "udpout://")


def simulate_command(
    scenario: Annotated[
        str, typer.Argument(help="A packaged scenario (demo, full ...) or a TOML file.")
    ] = "demo",
    seed: Annotated[int | None, typer.Option(help="Draws turbine, weather and launch.")] = None,
    speed: Annotated[str | None, typer.Option(help="A factor, or 'auto' (1 to 5).")] = None,
    sensors: Annotated[str | None, typer.Option(help="'wire' or 'bus'.")] = None,
    autopilot: Annotated[
        str | None, typer.Option(help="URL of another PX4-like simulator.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the missions.")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="section.key=value, as in a file.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print mission.json on stdout.")] = False,
    keep: Annotated[
        Path | None, typer.Option(help="Keep the processes' private files here.")
    ] = None,
) -> None:
    """Fly a whole inspection here: synthetic world, production path; exit 0 when it completed."""
    from rich.console import Console

    from drivers.bus import BusUnreachable
    from mission.cli.progress import LiveProgress
    from mission.cli.summary import print_summary
    from mission.processes.simulation import SimulationFailed, simulate
    from mission.records.summary import add_truth
    from mission.remote.client import NoReply

    overrides = list(set_ or [])
    for key, value in (
        ("simulation.seed", seed),
        ("simulation.speed", speed),
        ("simulation.sensors", sensors),
        ("simulation.autopilot_url", autopilot),
        ("missions_dir", out),
    ):
        if value is not None:
            overrides.append(f"{key}={value}")
    settings = load_scenario(scenario, overrides)
    _make_room(Path(settings.missions_dir), keep)
    console = Console(file=sys.stderr if as_json else sys.stdout)
    progress = LiveProgress(
        console,
        f"bladescout - {Path(scenario).stem}",
        waits_for="starting the world, its sensors and the daemon",
        silent=as_json,
    )
    try:
        with progress:
            outcome = simulate(settings, progress.on_state, progress.on_event, keep_run_dir=keep)
    except (SimulationFailed, BusUnreachable, NoReply) as error:
        end(Exit.DEVICE, str(error))
    except KeyboardInterrupt:
        end(Exit.UNFINISHED, "interrupted: the simulation was broken off")
    mission = add_truth(outcome.mission_dir, outcome.truth)
    if as_json:
        sys.stdout.write(json.dumps(mission) + "\n")
    else:
        print_summary(console, mission, outcome.mission_dir)
    raise typer.Exit(int(exit_of(outcome.state)))


def _make_room(missions: Path, keep: Path | None) -> None:
    if keep is not None and (keep / "field").exists():
        end(Exit.CONFIGURATION, f"--keep {keep}: holds an earlier run; name an empty folder")
    for folder in (missions, keep):
        try:
            if folder is not None:
                folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            end(Exit.CONFIGURATION, f"{folder}: no folder can be made there: {error.strerror}")


def load_scenario(scenario: str, overrides: list[str]) -> Settings:
    """Return the settings of a scenario, or end with one sentence."""
    from config.sources import ConfigError, load_settings, scenario_path

    try:
        path = Path(scenario) if scenario.endswith(".toml") else scenario_path(scenario)
        settings = load_settings([path], overrides=overrides)
    except ConfigError as error:
        end(Exit.CONFIGURATION, str(error))
    if not settings.sites:
        end(Exit.CONFIGURATION, f"{path}: sites: no turbine is listed; add a [[sites]] table")
    url = settings.simulation.autopilot_url
    if url and not url.startswith(_URLS):
        end(
            Exit.CONFIGURATION,
            f"simulation.autopilot_url = {url!r}: must be udpin://HOST:PORT or udpout://HOST:PORT",
        )
    return settings
