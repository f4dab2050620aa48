"""Where the blade lies in the frame that the vehicle reports in, between the scans too.

The LiDAR says ten times a second how far the blade lies beside its model; what it says is the mean
over the scans joined for it, and some time old. A reported position wanders and jitters meanwhile,
by decimetres in a second without RTK, while the reported velocity is good: what the position moves
beyond it is no motion, and moves the blade in the vehicle's frame as well. So the offset is carried
along by position less velocity at every tick, and each measurement corrects what it was at the
time measured. A distance flown by it is held to the blade, not to the world's position.
World ENU, metres, mission seconds.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from perception.values import Float

#: How fast the offset follows what the LiDAR says.
TIME_S = 0.5
#: Of the scans joined for a measurement.
WINDOW_S = 0.2
#: Velocity is integrated at most so long after the blade was last seen: it has an error too.
CARRIED_S = 1.0
#: Positions farther apart than this do not tell the motion between them.
GAP_S = 0.3
_KEPT = 40


class LiveOffset:
    """Offset (3,) of the blade from its model, as of the newest tick."""

    def __init__(self) -> None:
        self.value_w: Float = np.zeros(3)
        self._history: deque[tuple[float, Float]] = deque(maxlen=_KEPT)
        self._last: tuple[float, Float, Float] | None = None
        self._seen_s = -math.inf

    def begin(self, value_w: Float) -> None:
        """Begin with a guess (3,)."""
        self.value_w = value_w
        self._history.clear()
        self._seen_s = -math.inf

    def lean(self, value_w: Float, share: float) -> None:
        """Go a share of the way to what is known of the offset (3,) while the blade is not seen."""
        self.value_w = self.value_w + share * (value_w - self.value_w)

    def advance(self, now_s: float, position_w: Float, velocity_w: Float) -> None:
        """Carry the offset to a tick by the vehicle's reported position and velocity (3,)."""
        last, self._last = self._last, (now_s, position_w, velocity_w)
        if last is not None and now_s - self._seen_s < CARRIED_S and now_s - last[0] < GAP_S:
            flown = 0.5 * (velocity_w + last[2]) * (now_s - last[0])
            self.value_w = self.value_w + (position_w - last[1]) - flown
        self._history.append((now_s, self.value_w))

    def at(self, stamp_s: float) -> Float:
        """Return what was believed over the scans of a measurement that ended at a time."""
        then = [
            value for t_s, value in self._history if stamp_s - WINDOW_S <= t_s <= stamp_s + 1e-6
        ]
        return np.mean(then, axis=0) if then else self.value_w

    def correct(self, stamp_s: float, offset_w: Float, step_s: float) -> None:
        """Take a measured offset (3,), ``step_s`` after the one before."""
        change = (offset_w - self.at(stamp_s)) * (step_s / (TIME_S + step_s))
        self.value_w = self.value_w + change
        kept = [(t_s, value + change) for t_s, value in self._history]
        self._history = deque(kept, maxlen=_KEPT)
        self._seen_s = stamp_s
