"""The course of a flight for its report: a row a second of what an operator was shown."""

from __future__ import annotations

import math
from collections.abc import Iterable

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.bus import Key
from mission.remote.messages import StateMessage, VehicleMessage

PERIOD_S = 1.0
_UNFLOWN = frozenset({"idle", "preflight", "landed"})


class Course(BaseModel):
    """Columns of equal length; mission seconds, metres, shares. None: not known then."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    mission_s: tuple[float, ...] = ()
    phase: tuple[str, ...] = ()
    leg: tuple[str, ...] = ()
    """Blade and side that is flown along; empty between."""
    distance_m: tuple[float | None, ...] = ()
    """To the blade's axis."""
    clearance_m: tuple[float | None, ...] = ()
    """From the airframe's outermost point to the nearest thing the LiDAR sees."""
    height_m: tuple[float | None, ...] = ()
    battery: tuple[float | None, ...] = ()
    wind_mean_mps: float | None = None
    """As the autopilot estimated it in the air."""
    wind_max_mps: float | None = None
    wind_from_deg: float | None = Field(default=None, ge=0, le=360)


class CourseKeeper:
    """Takes what goes over the bus and keeps a row a second."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, str, str, float | None, float | None, float | None]] = []
        self._batteries: list[float | None] = []
        self._next_s = float("-inf")
        self._winds: list[tuple[float, float]] = []
        self._wind_due = False

    def take(self, key: str, payload: bytes) -> None:
        """Take one message; what is of no interest, or broken, is passed over."""
        try:
            if key == Key.STATE:
                self._take_state(StateMessage.model_validate_json(payload))
            elif key == Key.VEHICLE and self._wind_due:
                self._wind_due = False
                self._take_vehicle(VehicleMessage.model_validate_json(payload))
        except ValidationError:
            return

    def _take_state(self, state: StateMessage) -> None:
        if state.mission_s < self._next_s:
            return
        self._next_s = state.mission_s + 0.98 * PERIOD_S
        progress, place = state.progress, state.position_w
        along = progress.metre is not None and progress.blade
        leg = f"{progress.blade} {progress.side}" if along else ""
        self._rows.append(
            (
                round(state.mission_s, 2),
                str(progress.phase),
                leg,
                _rounded(progress.distance_m),
                _rounded(progress.clearance_m),
                None if place is None else _rounded(place[2]),
            )
        )
        self._batteries.append(_rounded(state.battery, 3))
        self._wind_due = progress.phase not in _UNFLOWN

    def _take_vehicle(self, message: VehicleMessage) -> None:
        if message.vehicle is not None and message.vehicle.wind_w is not None:
            east, north, _ = message.vehicle.wind_w
            self._winds.append((east, north))

    def course(self) -> Course:
        """Return what was kept."""
        if not self._rows:
            return Course()
        times, phases, legs, distances, clearances, heights = zip(*self._rows, strict=True)
        return Course(
            mission_s=times,
            phase=phases,
            leg=legs,
            distance_m=distances,
            clearance_m=clearances,
            height_m=heights,
            battery=tuple(self._batteries),
            **_wind(self._winds),
        )


def course_of(messages: Iterable[tuple[str, bytes]]) -> Course:
    """Return the course of a recorded flight from its (key, payload)."""
    keeper = CourseKeeper()
    for key, payload in messages:
        keeper.take(key, payload)
    return keeper.course()


def _wind(winds: list[tuple[float, float]]) -> dict[str, float]:
    """Return mean, greatest, and the direction the mean wind came from (compass)."""
    if not winds:
        return {}
    speeds = [math.hypot(east, north) for east, north in winds]
    east = sum(one for one, _ in winds)
    north = sum(one for _, one in winds)
    return {
        "wind_mean_mps": round(sum(speeds) / len(speeds), 2),
        "wind_max_mps": round(max(speeds), 2),
        "wind_from_deg": round(math.degrees(math.atan2(-east, -north)) % 360.0, 1),
    }


def _rounded(value: float | None, digits: int = 2) -> float | None:
    return None if value is None else round(value, digits)
