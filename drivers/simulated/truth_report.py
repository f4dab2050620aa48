"""What the field knows of a flown mission, written at its end beside the judgement."""

from __future__ import annotations

import json
from dataclasses import dataclass

Json = str | float | bool | None | list["Json"] | dict[str, "Json"]


@dataclass(frozen=True, slots=True)
class WorldFacts:
    """Truth of the world at the end of a mission."""

    mission_s: float
    setpoint_gap_ms: dict[str, float]
    setpoint_gap_wall_ms: dict[str, float]
    setpoints: int
    offboard_losses: int
    landed: bool
    armed: bool
    took_off: bool
    touchdown_mps: float
    wind_mean_mps: float
    wind_from_deg: float
    wind_max_mps: float
    battery_left: float | None
    energy_wh: float | None
    landing_error_m: float | None
    link: dict[str, int]
    faults: list[dict[str, str | float]]


class Nearness:
    """The least distance to the true mesh while airborne, and how often it was touched."""

    def __init__(self, radius_m: float) -> None:
        self._radius_m = radius_m
        self._touching = False
        self.collisions = 0
        self.least_m: float | None = None
        self.least_at_s: float | None = None

    def note(self, t_s: float, clearance_m: float) -> None:
        """Take one distance from the body's centre."""
        free_m = clearance_m - self._radius_m
        touching = free_m <= 0
        if touching and not self._touching:
            self.collisions += 1
        self._touching = touching
        if self.least_m is None or free_m < self.least_m:
            self.least_m, self.least_at_s = free_m, t_s


def truth_of(judgement: str, facts: WorldFacts, near: Nearness, wall_s: float) -> dict[str, Json]:
    """Return the judgement with the world's own truth added; ``wall_s``: since it was ready."""
    judged = json.loads(judgement)
    truth: dict[str, Json] = dict(judged) if isinstance(judged, dict) else {}
    truth["timing"] = {
        "setpoint_gap_ms": dict(facts.setpoint_gap_ms),
        "setpoint_gap_wall_ms": dict(facts.setpoint_gap_wall_ms),
        "setpoints": facts.setpoints,
        "real_time_factor": round(facts.mission_s / wall_s, 3) if wall_s > 0 else None,
        "mission_s": round(facts.mission_s, 3),
        "wall_s": round(wall_s, 3),
    }
    truth["wind"] = {
        "mean_mps": round(facts.wind_mean_mps, 2),
        "from_deg": round(facts.wind_from_deg, 1),
        "max_mps": round(facts.wind_max_mps, 2),
    }
    truth["vehicle"] = {
        "took_off": facts.took_off,
        "landed": facts.landed,
        "armed": facts.armed,
        "touchdown_mps": round(facts.touchdown_mps, 2),
        "landing_error_m": facts.landing_error_m,
        "offboard_losses": facts.offboard_losses,
        "battery_left": facts.battery_left,
        "energy_wh": facts.energy_wh,
        "collisions": near.collisions,
        "least_clearance_m": near.least_m,
        "least_clearance_at_s": near.least_at_s,
        "link": dict(facts.link),
    }
    truth["faults"] = [dict(fault) for fault in facts.faults]
    return truth
