"""What EV a camera may be asked for: its steps, its ends, and the shutter that motion allows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from perception.values import Float


@dataclass(frozen=True, slots=True)
class EvSteps:
    """The EVs that a camera has, ascending."""

    evs: tuple[float, ...]

    @classmethod
    def spaced(cls, min_ev: float, max_ev: float, step_ev: float) -> EvSteps:
        """Return the multiples of a step between two ends, the ends themselves included."""
        low, high = math.ceil(min_ev / step_ev - 1e-6), math.floor(max_ev / step_ev + 1e-6)
        inside = {round(k * step_ev, 6) for k in range(low, high + 1)}
        return (
            cls(tuple(sorted(inside | {min_ev, max_ev})))
            if not inside
            else cls(tuple(sorted(inside)))
        )

    def nearest(self, ev: float, ceiling_ev: float = math.inf) -> float:
        """Return the nearest EV that is not above a ceiling; the lowest where all are."""
        allowed = [one for one in self.evs if one <= ceiling_ev + 1e-6] or [self.evs[0]]
        return min(allowed, key=lambda one: abs(one - ev))

    def width_at(self, ev: float) -> float:
        """Return the distance between neighbours round an EV."""
        if len(self.evs) < 2:
            return 1.0
        gaps: Float = np.diff(np.asarray(self.evs))
        return float(gaps[min(int(np.searchsorted(self.evs[1:], ev)), len(gaps) - 1)])


def longest_shutter_s(max_blur_px: float, gsd_m: float, speed_mps: float) -> float:
    """Return the exposure time in which the picture moves by no more than so many pixels."""
    return math.inf if speed_mps <= 0 else max_blur_px * gsd_m / speed_mps


def ceiling_ev(told: Sequence[tuple[float, float]], longest_s: float) -> float:
    """Return the highest EV whose shutter is short enough, inf while no report says otherwise.

    ``told``: (EV, shutter in s) as the camera reported them. Below the EV of a shutter that is too
    long, one EV is taken for one halving; what a camera does with its gain shows in its reports.
    """
    return min(
        (ev - math.log2(shutter / longest_s) for ev, shutter in told if shutter > longest_s),
        default=math.inf,
    )
