"""Missions of the tracking bench flown again in real processes, as `bladescout simulate` does.

The same draw (turbine, stop angle, wind, receiver) becomes a scenario file; everything between
the aircraft and the flight is then the real thing: MAVLink, the LiDAR's packets, RTSP, stills, and
light that the exposure has to follow. The figures are those of ``mission.json``: distances as the
flight measured them, coverage and metres by the field's truth.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from benchmarks.missions import NotFlown, simulate
from benchmarks.tracking import (
    METRE_GOALS_M,
    REACHABLE_GOAL,
    SIDE_GOALS,
    WIND_GOALS_M,
    Row,
    at_least,
    at_most,
)
from benchmarks.tracking_trials import Trial, draw_trial
from config.errors import first_fault
from mission.records.mission_file import MissionFile

TIMEOUT_S = 3600.0
MAX_DURATION_S = 6000.0


@dataclass(frozen=True, slots=True)
class Wired:
    """A mission as it ended; ``told`` is None where it ended without a ``mission.json``."""

    number: int
    model: str
    wind: str
    profile: str
    state: str
    words: str
    told: MissionFile | None = None


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
    drawn = (trial.number, trial.model, trial.wind, trial.profile)
    try:
        found, _ = simulate([str(scenario), "--out", str(out)], TIMEOUT_S)
        told = MissionFile.model_validate(found)
    except NotFlown as error:
        return Wired(*drawn, "failed", str(error))
    except ValidationError as error:
        return Wired(*drawn, "failed", first_fault(error))
    return Wired(*drawn, told.state, told.words, told)


def rows(flown: Sequence[Wired]) -> list[Row]:
    """Return the figures of what was flown, with the bench's goals."""
    completed = float(np.mean([one.state == "completed" for one in flown]))
    found = [at_least("completed, share", completed, 1.0)]
    told = [one.told for one in flown if one.told is not None]
    if not told:
        return found
    for wind, goal in WIND_GOALS_M:
        passes = [p for one in flown if one.told and one.wind == wind for p in one.told.passes]
        # By the photos, which stand evenly along a blade.
        errors = [(p.distance_m.rms_error, p.photos) for p in passes]
        squares = [(rms**2, photos) for rms, photos in errors if rms is not None]
        if sum(weight for _, weight in squares):
            values, weights = np.array(squares).T
            rms = float(np.sqrt(np.average(values, weights=weights)))
            found.append(at_most(f"distance RMS error as measured, {wind}, m", rms, goal))
    whole = [one.truth for one in told if one.state == "completed" and one.truth is not None]
    for side, goal in SIDE_GOALS if whole else ():
        seen = _of_side(side, [truth.coverage for truth in whole])
        found.append(at_least(f"coverage {side}, whole, mean", seen, goal))
    for side, _ in SIDE_GOALS if whole else ():
        seen = _of_side(side, [truth.coverage_reachable for truth in whole])
        found.append(at_least(f"coverage {side}, of the reachable", seen, REACHABLE_GOAL))
    for profile, goal in METRE_GOALS_M:
        metres = [
            one.told.errors.photo_metres.p95_m
            for one in flown
            if one.told and one.told.errors and one.told.errors.photo_metres
            if one.profile == profile
        ]
        if metres:
            name = f"metre error, {profile}, p95, worst mission, m"
            found.append(at_most(name, max(metres), goal))
    found += _centred_rows(flown)
    truths = [one.truth.min_clearance_m for one in told if one.truth is not None]
    clearances = [clearance for clearance in truths if clearance is not None]
    if clearances:
        found.append(at_least("least true clearance, m", min(clearances), 8.0))
    minutes = [one.duration_s / 60.0 for one in told]
    found.append(Row("minutes a turbine, mean", float(np.mean(minutes)), "", None))
    swaps = float(np.mean([one.swaps for one in told]))
    found.append(Row("batteries changed a turbine, mean", swaps, "", None))
    return found


def _centred_rows(flown: Sequence[Wired]) -> list[Row]:
    """Return the share of photos that have the blade in their middle, by the true mesh."""
    found = []
    for profile, goal in (("", 0.95), ("rtk", None), ("gnss", None)):
        shares = [
            (one.told.truth.stills_centred, one.told.photos.kept)
            for one in flown
            if one.told and one.told.truth and one.told.truth.stills_centred is not None
            if profile in ("", one.profile)
        ]
        if sum(kept for _, kept in shares):
            values, weights = np.array(shares).T
            name = "blade within 5 % of the middle" + (f", {profile}" if profile else "")
            found.append(at_least(name, float(np.average(values, weights=weights)), goal))
    return found


def _of_side(side: str, coverage: Sequence[dict[str, dict[str, float | None]]]) -> float:
    """Return the mean over missions and blades of what was seen of a side."""
    seen = [by.get(side) for blades in coverage for by in blades.values()]
    return float(np.mean([share for share in seen if share is not None]))
