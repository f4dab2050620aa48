"""The blade beside the vehicle, from the last scans: where flight is told that it really hangs."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np

from config.turbine import Turbine
from mission.flight.command import SensingTask
from mission.flight.observation import BladeTrack, Vec3
from perception.blade_line import fit_blade_line, outside_cone
from perception.values import Float

#: Scans are joined over this time for the blade's line.
BLADE_WINDOW_S = 0.3
#: Points this near to tower and nacelle are theirs: the position may be off by so much.
OTHERS_SKIN_M = 0.6


class BladeFollower:
    """Joins the scans of a task and fits the blade's line to them (Eq. 3)."""

    def __init__(self, turbines: Mapping[str, Turbine]) -> None:
        """``turbines``: dimensions by the name of the site."""
        self._turbines = turbines
        self._task_id = -1
        self._recent: deque[tuple[float, Float]] = deque()

    def follow(
        self, task: SensingTask, points_w: Float, stamp_s: float, position_w: Float
    ) -> BladeTrack | None:
        """Take one scan, (N, 3) world metres; return the blade, None where too little is seen."""
        if task.task_id != self._task_id:
            self._task_id = task.task_id
            self._recent.clear()
        self._recent.append((stamp_s, points_w))
        while self._recent and stamp_s - self._recent[0][0] > BLADE_WINDOW_S:
            self._recent.popleft()
        if task.blade_root_w is None or task.blade_tip_w is None:
            return None
        joined = np.concatenate([points for _, points in self._recent])
        for end_w, other_w, radius_m, other_radius_m in task.others:
            radii = (radius_m + OTHERS_SKIN_M, other_radius_m + OTHERS_SKIN_M)
            joined = outside_cone(joined, np.asarray(end_w), np.asarray(other_w), radii)
        line = fit_blade_line(
            joined,
            position_w,
            np.asarray(task.blade_root_w),
            np.asarray(task.blade_tip_w),
            task.half_width_m,
            half_thickness_m=_half_depth(self._turbines.get(task.turbine), task, position_w),
        )
        if line is None:
            return None
        window_s = max(stamp_s - self._recent[0][0], 0.1)
        return BladeTrack(
            stamp_s=stamp_s,
            blade=task.blade,
            foot_w=_vec(line.foot_w),
            direction_w=_vec(line.direction_w),
            distance_m=line.distance_m,
            points_per_s=line.points / window_s,
            offset_w=_vec(line.offset_w),
            residual_m=line.residual_m,
            tip_m=line.tip_m,
        )


def _half_depth(turbine: Turbine | None, task: SensingTask, position_w: Float) -> float:
    """Return how far behind the near skin the axis lies, seen square to the chord."""
    if turbine is None or task.blade_root_w is None or task.blade_tip_w is None:
        return 0.0
    root_w, tip_w = np.asarray(task.blade_root_w), np.asarray(task.blade_tip_w)
    length = float(np.linalg.norm(tip_w - root_w))
    share = float((position_w - root_w) @ (tip_w - root_w)) / length**2
    blade = turbine.blade
    chord = float(np.interp(share, blade.span, blade.chord_m))
    if task.side in ("LE", "TE"):
        axis = float(np.interp(share, blade.span, blade.pitch_axis))
        return chord * (axis if task.side == "LE" else 1.0 - axis)
    return 0.5 * chord * float(np.interp(share, blade.span, blade.thickness))


def _vec(values: Float) -> Vec3:
    return float(values[0]), float(values[1]), float(values[2])
