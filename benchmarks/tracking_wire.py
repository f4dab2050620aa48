"""Missions of the tracking bench flown again in real processes, as `bladescout simulate` does.

The same draw (turbine, stop angle, wind, receiver) becomes a scenario file; everything between
the aircraft and the flight is then the real thing: MAVLink, the LiDAR's packets, RTSP, stills, and
light that the exposure has to follow. The figures are those of ``mission.json``: distances as the
flight measured them, coverage and metres by the field's truth.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict

from benchmarks.tracking import Row, at_least, at_most
from benchmarks.tracking_trials import Trial, draw_trial

TIMEOUT_S = 3600.0
MAX_DURATION_S = 6000.0
_SIDES = (("PS", 0.95), ("SS", 0.95), ("LE", 0.9), ("TE", 0.9))


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore")


class _Distance(_Part):
    rms_error: float


class _Pass(_Part):
    photos: int
    distance_m: _Distance | None = None


class _Metres(_Part):
    p95_m: float


class _Errors(_Part):
    photo_metres: _Metres | None = None


class _Truth(_Part):
    min_clearance_m: float
    coverage: dict[str, dict[str, float]]
    coverage_reachable: dict[str, dict[str, float]]


class Told(_Part):
    """What is read of a ``mission.json``."""

    state: str
    words: str
    duration_s: float
    swaps: int
    passes: tuple[_Pass, ...]
    errors: _Errors
    truth: _Truth


@dataclass(frozen=True, slots=True)
class Wired:
    """A mission as it ended; ``told`` is None where it ended without a ``mission.json``."""

    number: int
    model: str
    wind: str
    profile: str
    state: str
    words: str
    told: Told | None = None


def fly(seed: int, numbers: Sequence[int], out: Path) -> Iterator[Wired]:
    """Fly missions of a seed one after the other; their folders are kept in ``out``."""
    out.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        trial = draw_trial(seed, number)
        scenario = out / f"tracking-{seed}-{number}.toml"
        scenario.write_text(scenario_of(trial))
        yield _flown(trial, scenario, out)


def scenario_of(trial: Trial) -> str:
    """Return a trial as a scenario file."""
    site, drawn = trial.settings.sites[0], trial.settings.simulation
    wind = drawn.wind
    return "\n".join(
        [
            "[[sites]]",
            f'name = "{site.name}"',
            f'turbine = "{site.turbine}"',
            f"scale = {site.scale}",
            "[simulation]",
            f"seed = {drawn.seed}",
            f'position_profile = "{drawn.position_profile}"',
            f"max_duration_s = {MAX_DURATION_S}",
            "[simulation.truth]",
            f"stop_angle_deg = {drawn.truth.stop_angle_deg}",
            "[simulation.wind]",
            f"mean_mps = {wind.mean_mps}",
            f"turbulence = {wind.turbulence}",
            f"gust_mps = {wind.gust_mps}",
            f"gust_at_s = {wind.gust_at_s}",
            "",
        ]
    )


def _flown(trial: Trial, scenario: Path, out: Path) -> Wired:
    words = [sys.executable, "-m", "mission.cli.main", "simulate", str(scenario), "--json"]
    drawn = (trial.number, trial.model, trial.wind, trial.profile)
    try:
        ran = subprocess.run(
            [*words, "--out", str(out)],
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Wired(*drawn, "failed", f"no end within {TIMEOUT_S:.0f} s")
    try:
        told = Told.model_validate(json.loads(ran.stdout))
    except ValueError:
        last = (ran.stderr.strip().splitlines() or ["nothing was said"])[-1]
        return Wired(*drawn, "failed", last)
    return Wired(*drawn, told.state, told.words, told)


def rows(flown: Sequence[Wired]) -> list[Row]:
    """Return the figures of what was flown, with the bench's goals."""
    completed = float(np.mean([one.state == "completed" for one in flown]))
    found = [at_least("completed, share", completed, 1.0)]
    told = [one.told for one in flown if one.told is not None]
    if not told:
        return found
    for wind, goal in (("5 m/s", 0.25), ("9 m/s", 0.4), ("gust to 15", None)):
        passes = [p for one in flown if one.told and one.wind == wind for p in one.told.passes]
        # By the photos, which stand evenly along a blade.
        squares = [(p.distance_m.rms_error**2, p.photos) for p in passes if p.distance_m]
        if sum(weight for _, weight in squares):
            values, weights = np.array(squares).T
            rms = float(np.sqrt(np.average(values, weights=weights)))
            found.append(at_most(f"distance RMS error as measured, {wind}, m", rms, goal))
    whole = [one for one in told if one.state == "completed"]
    for side, goal in _SIDES if whole else ():
        seen = [by[side] for one in whole for by in one.truth.coverage.values()]
        found.append(at_least(f"coverage {side}, whole, mean", float(np.mean(seen)), goal))
    for side, _ in _SIDES if whole else ():
        seen = [by[side] for one in whole for by in one.truth.coverage_reachable.values()]
        found.append(at_least(f"coverage {side}, of the reachable", float(np.mean(seen)), 0.99))
    for profile, goal in (("rtk", 0.3), ("gnss", 1.0)):
        metres = [
            one.told.errors.photo_metres.p95_m
            for one in flown
            if one.told and one.told.errors.photo_metres and one.profile == profile
        ]
        if metres:
            name = f"metre error, {profile}, p95, worst mission, m"
            found.append(at_most(name, max(metres), goal))
    least = min(one.truth.min_clearance_m for one in told)
    found.append(at_least("least true clearance, m", least, 8.0))
    minutes = [one.duration_s / 60.0 for one in told]
    found.append(Row("minutes a turbine, mean", float(np.mean(minutes)), "", None))
    swaps = float(np.mean([one.swaps for one in told]))
    found.append(Row("batteries changed a turbine, mean", swaps, "", None))
    return found
