"""What EV a camera may be asked for: its steps and its ends."""

from __future__ import annotations

import math
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

    def nearest(self, ev: float) -> float:
        """Return the nearest EV."""
        return min(self.evs, key=lambda one: abs(one - ev))

    def width_at(self, ev: float) -> float:
        """Return the distance between neighbours round an EV."""
        if len(self.evs) < 2:
            return 1.0
        gaps: Float = np.diff(np.asarray(self.evs))
        return float(gaps[min(int(np.searchsorted(self.evs[1:], ev)), len(gaps) - 1)])
