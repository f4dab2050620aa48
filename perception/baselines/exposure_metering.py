"""Whole-picture mean metering (AE-30, -50, -70), re-implemented.

After the classical methods that Gamache et al. compare (BorealHDR): the mean of the whole picture
is brought to a share of full scale. There the exposure time moves by a fixed number of ms a count;
here by a share of the way in EV, which is the usual form T' = T (target / mean) ^ gain and does
not depend on where the exposure stands.
"""

from __future__ import annotations

import math

from perception.values import Bytes

#: Counts of 255 off the target that are left alone.
DEAD_BAND = 1.0
#: A picture all white or black says no more than this.
MAX_CHANGE_EV = 2.0


class MeanMetering:
    """Brings the mean of the picture to a share of full scale."""

    def __init__(self, share: float, gain: float) -> None:
        """``share``: of 255, wanted; ``gain``: EV moved per log2 of target over mean."""
        self._target = 255.0 * share
        self._gain = gain

    def update(self, grey: Bytes, ev: float) -> float:
        """Return the EV wanted after a picture (H, W) that was exposed with ``ev``."""
        mean = float(grey.mean())
        if abs(mean - self._target) < DEAD_BAND:
            return ev
        change = self._gain * math.log2(self._target / max(mean, 1.0))
        return ev + min(max(change, -MAX_CHANGE_EV), MAX_CHANGE_EV)
