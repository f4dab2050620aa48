"""The blade beside the vehicle, from the last scans: where flight is told that it really hangs."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np

from config.photos import Positioning
from config.turbine import Turbine
from mission.flight.command import SensingTask
from mission.flight.observation import BladeTrack, TurbineSeen
from mission.flight.sides import blade_frame
from mission.processes.turbine_sight import TurbineSight
from perception.blade_line import fit_blade_line, outside_cone
from perception.clearance import Followed
from perception.geometry import vec3
from perception.section_depth import SectionDepth
from perception.values import Float

#: Scans are joined over this time for the blade's line.
BLADE_WINDOW_S = 0.3
#: Points this near to tower and nacelle are theirs: the position may be off by so much.
OTHERS_SKIN_M = 0.6
#: What of the followed blade was not seen again for so long is left to the model: farther from the
#: modelled axis than the points that are taken for the blade's it may have been by the drift.
FOLLOWED_S, FOLLOWED_DRIFT_M = 1.5, 3.0
#: And of everything else, when a position may have drifted by so much; at most so long.
KEPT_DRIFT_M, KEPT_S = 0.8, 120.0


def kept_s(positioning: Positioning) -> float:
    """Return for how long a place that is not seen again is told to the guard."""
    drift_m2 = 2 * positioning.wander_sigma_m**2
    return min(KEPT_S, positioning.wander_s * KEPT_DRIFT_M**2 / max(drift_m2, 1e-6))


def followed(task: SensingTask, stamp_s: float) -> Followed | None:
    """Return the blade of a task, of which only what was seen just now is an obstacle."""
    if task.blade_root_w is None or task.blade_tip_w is None:
        return None
    reach_m = task.half_width_m + FOLLOWED_DRIFT_M
    root_w, tip_w = np.asarray(task.blade_root_w), np.asarray(task.blade_tip_w)
    return Followed(root_w, tip_w, reach_m, stamp_s - FOLLOWED_S)


#: Radius of a leading edge over the chord; and from which thickness on a section is a cylinder.
EDGE_ROUND, ROUND_SECTION = 0.03, 0.9


class BladeFollower:
    """Joins the scans of a task and fits the blade's line to them (Eq. 3)."""

    def __init__(
        self, turbines: Mapping[str, Turbine], positioning: Positioning | None = None
    ) -> None:
        """``turbines``: dimensions by the name of the site."""
        self._turbines = turbines
        self._sight = TurbineSight(positioning or Positioning())
        self._seen: TurbineSeen | None = None
        self._task_id = -1
        self._recent: deque[tuple[float, Float]] = deque()

    def follow(
        self,
        task: SensingTask,
        points_w: Float,
        stamp_s: float,
        position_w: Float,
        velocity_w: Float | None = None,
    ) -> BladeTrack | None:
        """Take one scan, (N, 3) world metres; return the blade, None where too little is seen.

        ``position_w``, ``velocity_w``: (3,) of the vehicle; without the latter the turbine as a
        whole is not looked for.
        """
        if task.task_id != self._task_id:
            self._task_id = task.task_id
            self._recent.clear()
        self._recent.append((stamp_s, points_w))
        while self._recent and stamp_s - self._recent[0][0] > BLADE_WINDOW_S:
            self._recent.popleft()
        if velocity_w is not None:
            turbine = self._turbines.get(task.turbine)
            seen = self._sight.take(task, turbine, points_w, stamp_s, position_w, velocity_w)
            self._seen = seen or self._seen
            if task.blind and seen is not None:
                return _unseen(task, stamp_s, position_w, seen)
        if task.blade_root_w is None or task.blade_tip_w is None or task.blind:
            return None
        joined = self._without_others(task, stamp_s, position_w)
        root_w, tip_w = np.asarray(task.blade_root_w), np.asarray(task.blade_tip_w)
        moved_w = self._moved_beside(root_w, tip_w, stamp_s, position_w)
        line = fit_blade_line(
            joined,
            position_w,
            root_w + moved_w,
            tip_w + moved_w,
            task.half_width_m,
            depth=_depth(self._turbines.get(task.turbine), task),
        )
        if line is None:
            return None
        window_s = max(stamp_s - self._recent[0][0], 0.1)
        return BladeTrack(
            stamp_s=stamp_s,
            blade=task.blade,
            foot_w=vec3(line.foot_w),
            direction_w=vec3(line.direction_w),
            distance_m=line.distance_m,
            points_per_s=line.points / window_s,
            offset_w=vec3(line.offset_w + moved_w),
            residual_m=line.residual_m,
            tip_m=line.tip_m,
            turbine=self._seen,
        )

    def _without_others(self, task: SensingTask, stamp_s: float, position_w: Float) -> Float:
        """Return the joined points (N, 3) without those of tower and nacelle, where they appear."""
        joined = np.concatenate([points for _, points in self._recent])
        for end_w, other_w, radius_m, other_radius_m in task.others:
            ends_w = np.array([end_w, other_w])
            ends_w = ends_w + self._sight.appears_moved(ends_w, stamp_s, position_w)
            radii = (radius_m + OTHERS_SKIN_M, other_radius_m + OTHERS_SKIN_M)
            joined = outside_cone(joined, ends_w[0], ends_w[1], radii)
        return joined

    def _moved_beside(
        self, root_w: Float, tip_w: Float, stamp_s: float, position_w: Float
    ) -> Float:
        """Return how far (3,) beside its axis the blade is to be looked for.

        Points are taken within a chord of it: a position off by metres would cut the blade.
        """
        axis_w = (tip_w - root_w) / np.linalg.norm(tip_w - root_w)
        foot_w = root_w + float((position_w - root_w) @ axis_w) * axis_w
        moved_w = self._sight.appears_moved(foot_w[None], stamp_s, position_w)[0]
        return np.asarray(moved_w - float(moved_w @ axis_w) * axis_w, np.float64)


def _chord(turbine: Turbine, task: SensingTask) -> tuple[Float | None, Float | None, Float | None]:
    """Return both ends of the chord (S, 3) from the bent axis, and the axis' own bend (S, 3).

    None where the pitch is not known.
    """
    told = [one for one in task.blades if one.name == task.blade and one.pitch_deg is not None]
    if not told or told[0].pitch_deg is None or task.hub_w is None or task.normal_w is None:
        return None, None, None
    hub_w, normal_w = np.asarray(task.hub_w), np.asarray(task.normal_w)
    axis_w, pitch = np.asarray(told[0].direction_w), told[0].pitch_deg
    frame = blade_frame(task.blade, hub_w, normal_w, axis_w, pitch, turbine)
    shape = turbine.blade
    turned = np.radians(pitch + np.asarray(shape.twist_deg))[:, None]
    lead = np.cos(turned) * frame.rotation_w + np.sin(turned) * frame.upwind_w
    chord, share = np.asarray(shape.chord_m)[:, None], np.asarray(shape.pitch_axis)[:, None]
    bend = np.asarray(shape.prebend_m)[:, None] * frame.pressure(np.radians(pitch))
    return share * chord * lead, (share - 1.0) * chord * lead, bend


def _size(vectors: Float) -> Float:
    """Return the lengths (S,) of vectors (S, 3)."""
    return np.asarray(np.linalg.norm(vectors, axis=1), np.float64)


def _unseen(
    task: SensingTask, stamp_s: float, position_w: Float, seen: TurbineSeen
) -> BladeTrack | None:
    """Return a blade that only its model tells of, with what was seen of the whole turbine."""
    if task.blade_root_w is None or task.blade_tip_w is None:
        return None
    root = np.asarray(task.blade_root_w)
    axis = np.asarray(task.blade_tip_w) - root
    axis = axis / np.linalg.norm(axis)
    here = position_w - np.asarray(seen.offset_w)
    foot = root + float((here - root) @ axis) * axis + np.asarray(seen.offset_w)
    return BladeTrack(
        stamp_s=stamp_s,
        blade=task.blade,
        foot_w=vec3(foot),
        direction_w=vec3(axis),
        distance_m=float(np.linalg.norm(foot - position_w)),
        points_per_s=0.0,
        offset_w=(0.0, 0.0, 0.0),
        residual_m=0.0,
        from_model=True,
        turbine=seen,
    )


def _depth(turbine: Turbine | None, task: SensingTask) -> SectionDepth | None:
    """Return how far behind the near skin the axis lies, seen square to the chord or along it."""
    if turbine is None:
        return None
    blade, edge = turbine.blade, task.side in ("LE", "TE")
    chord, axis = np.asarray(blade.chord_m), np.asarray(blade.pitch_axis)
    metre = np.asarray(blade.span) * turbine.blade_length_m
    half = 0.5 * chord * np.asarray(blade.thickness)
    leading, trailing, bend = _chord(turbine, task)
    if not edge:
        return SectionDepth(metre, half, edge, leading, trailing, bend_w=bend)
    turned = np.radians(np.asarray(blade.twist_deg) - np.interp(0.5, blade.span, blade.twist_deg))
    # From the round end of the edge, twisted out of the view, to the axis.
    round_m = np.minimum(half, EDGE_ROUND * chord) if task.side == "LE" else 0.0
    round_m = np.where(np.asarray(blade.thickness) > ROUND_SECTION, half, round_m)
    ahead = chord * (axis if task.side == "LE" else 1.0 - axis) - round_m
    # The chord's ends are the middles of the edges' round.
    shrunk = [
        None if end is None else end * (1 - round_m / np.maximum(_size(end), 1e-6))[:, None]
        for end in (leading, trailing)
    ]
    depth = ahead * np.cos(turned) + round_m
    return SectionDepth(metre, depth, edge, shrunk[0], shrunk[1], round_m, bend)
