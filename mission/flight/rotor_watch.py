"""Has the rotor moved since it was measured? Each blade's direction is measured anew when flown.

Along a pass the LiDAR tells where the blade's axis lies beside the modelled one; its slope over the
metres is the angle by which the blade has turned: within the rotor plane (the rotor turned on), or
out of it (the nacelle yawed). A constant offset is the vehicle's own drift and says nothing; a
drift that grows during the pass looks like a turn, so what counts as one depends on how well the
position is known. Blades bend and have two skins: out of the plane a pass is compared only with the
first one of the same blade and side that looked from where it looks. World ENU, metres; pure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mission.flight.command import SensingMode, SensingTask
from mission.flight.flight import Flight
from mission.flight.observation import BladeTrack
from perception.values import Float

#: Of the blade's length: near the root the nacelle, near the tip the bend spoils the line.
FROM_SHARE, TO_SHARE = 0.1, 0.85
LEAST_SPAN_SHARE = 0.5
LEAST_TRACKS = 50
LEAST_POINTS_PER_S = 100.0
#: Tracks that scatter by more about their line show no line.
MOST_SCATTER_M = 0.3
#: An offset as large is another thing's.
MOST_OFFSET_M = 6.0
#: A blade that lies off by more has moved, beyond what the position may have drifted meanwhile.
MOVED_RAD = math.radians(2.0)
RTK_DRIFT_M, OTHER_DRIFT_M = 0.8, 3.0
RTK_FIX = 6
#: Views that differ by less than this (cosine of 10 deg) show the same skin.
SAME_VIEW = math.cos(math.radians(10.0))
#: A moving rotor goes on moving: seen for so long, in one pass.
SEEN_S = 2.0
EVERY_S = 0.5


@dataclass(frozen=True, slots=True)
class BladeTurn:
    """How far a blade lies from its model, by its slope."""

    in_plane_rad: float
    """Counter-clockwise seen from the front, as the stop angle grows."""
    out_of_plane_rad: float
    """Towards downwind."""
    span_m: float
    scatter_m: float


@dataclass(slots=True)
class _Pass:
    task_id: int
    side: tuple[str, str] = ("", "")
    """Blade and side."""
    view_w: Float | None = None
    """(3,) unit, from the blade to the vehicle, as the pass began."""
    metres: list[float] = field(default_factory=list)
    offsets: list[tuple[float, float]] = field(default_factory=list)
    beyond_s: float | None = None
    """Since when the blade is seen elsewhere."""
    computed_s: float = -math.inf
    turn: BladeTurn | None = None


class RotorWatch:
    """Remembers the passes over the blades of one measured rotor."""

    def __init__(self) -> None:
        self._rotor_s: float | None = None
        self._stamp_s = -math.inf
        self._pass = _Pass(-1)
        self._first: list[tuple[tuple[str, str], Float, float]] = []
        """Blade and side, from where it was looked at, and what showed out of the plane."""
        self.turns: dict[str, BladeTurn] = {}
        """The newest of each blade, for the record."""

    def moved(self, flight: Flight) -> bool:
        """Take in the newest track; return whether it shows a rotor that has moved."""
        rotor, track, task = flight.rotor, flight.observation.blade, flight.task
        if rotor is None or task.mode is not SensingMode.BLADE:
            return False
        if rotor.stamp_s != self._rotor_s:
            self._rotor_s, self._pass = rotor.stamp_s, _Pass(-1)
            self._first.clear()
            self.turns.clear()
        if task.task_id != self._pass.task_id:
            self._next(task)
        # From the way to a leg a blade is seen aslant: its nearest points are not its axis.
        if flight.on_leg and track is not None and track.stamp_s > self._stamp_s:
            self._stamp_s = track.stamp_s
            self._take(track, task, flight.here_w)
        return self._beyond(flight, task)

    def _next(self, task: SensingTask) -> None:
        """Begin a pass; what the first one of a side showed is what later ones are held to."""
        over = self._pass
        if over.turn is not None and over.view_w is not None and self._shown(over) is None:
            self._first.append((over.side, over.view_w, over.turn.out_of_plane_rad))
        self._pass = _Pass(task.task_id, (task.blade, task.side))

    def _shown(self, over: _Pass) -> float | None:
        """Return what the first pass that looked from there showed out of the plane."""
        view_w = over.view_w
        for side, seen_from_w, out_of_plane_rad in self._first:
            if side == over.side and view_w is not None and view_w @ seen_from_w > SAME_VIEW:
                return out_of_plane_rad
        return None

    def _take(self, track: BladeTrack, task: SensingTask, here_w: Float) -> None:
        root_w, tip_w = task.blade_root_w, task.blade_tip_w
        if root_w is None or tip_w is None or task.normal_w is None:
            return
        seen = track.blade == task.blade and not track.from_model
        if not seen or track.points_per_s < LEAST_POINTS_PER_S:
            return
        root, axis = np.array(root_w), np.array(tip_w) - np.array(root_w)
        length = float(np.linalg.norm(axis))
        axis = axis / length
        offset = np.array(track.offset_w)
        metre = float((np.array(track.foot_w) - offset - root) @ axis)
        size = float(np.linalg.norm(offset))
        # Written so that NaN is left out, too.
        if not (FROM_SHARE * length < metre < TO_SHARE * length and size < MOST_OFFSET_M):
            return
        normal = np.array(task.normal_w)
        normal = normal - (normal @ axis) * axis
        normal = normal / np.linalg.norm(normal)
        # With the rotation axis pointing downwind, counter-clockwise from the front is along this.
        onward = np.cross(axis, normal)
        if self._pass.view_w is None:
            away = here_w - np.array(track.foot_w)
            self._pass.view_w = away / max(float(np.linalg.norm(away)), 1e-6)
        self._pass.metres.append(metre)
        self._pass.offsets.append((float(offset @ onward), float(offset @ normal)))

    def _beyond(self, flight: Flight, task: SensingTask) -> bool:
        now, current = flight.now_s, self._pass
        if now - current.computed_s >= EVERY_S:
            current.computed_s = now
            current.turn = _turn(current, task)
            if not self._elsewhere(flight, task, current.turn):
                current.beyond_s = None
            elif current.beyond_s is None:
                current.beyond_s = now
        return current.beyond_s is not None and now - current.beyond_s >= SEEN_S

    def _elsewhere(self, flight: Flight, task: SensingTask, turn: BladeTurn | None) -> bool:
        if turn is None:
            return False
        self.turns[task.blade] = turn
        limit = MOVED_RAD + math.atan2(_drift_m(flight), turn.span_m)
        shown = self._shown(self._pass)
        first = turn.out_of_plane_rad if shown is None else shown
        return abs(turn.in_plane_rad) > limit or abs(turn.out_of_plane_rad - first) > limit


def _turn(current: _Pass, task: SensingTask) -> BladeTurn | None:
    """Return the slopes of the offsets over the metres; None where the pass shows too little."""
    if task.blade_root_w is None or task.blade_tip_w is None:
        return None
    length = math.dist(task.blade_root_w, task.blade_tip_w)
    if len(current.metres) < LEAST_TRACKS:
        return None
    metres, offsets = np.array(current.metres), np.array(current.offsets)
    span = float(np.ptp(metres))
    if span < LEAST_SPAN_SHARE * length:
        return None
    in_plane, scatter = _slope(metres, offsets[:, 0])
    out_of_plane, scatter_out = _slope(metres, offsets[:, 1])
    worst = max(scatter, scatter_out)
    if worst > MOST_SCATTER_M:
        return None
    return BladeTurn(math.atan(in_plane), math.atan(out_of_plane), span, worst)


def _slope(metres: Float, offsets: Float) -> tuple[float, float]:
    """Return slope and scatter of a robust line through offsets (N,) over metres (N,)."""
    columns = np.stack([np.ones_like(metres), metres - metres.mean()], axis=1)
    weight = np.ones_like(metres)
    slope = scatter = 0.0
    for _ in range(6):
        line = np.linalg.lstsq(columns * weight[:, None], offsets * weight, rcond=None)[0]
        residual = offsets - columns @ line
        slope, scatter = float(line[1]), 1.5 * float(np.median(np.abs(residual)))
        weight = 1 / np.sqrt(1 + (residual / max(scatter, 0.03)) ** 2)
    return slope, scatter


def _drift_m(flight: Flight) -> float:
    """Return how far the position may wander during a pass."""
    vehicle = flight.observation.vehicle
    fixed = vehicle is not None and vehicle.gps_fix == RTK_FIX
    return RTK_DRIFT_M if fixed else OTHER_DRIFT_M
