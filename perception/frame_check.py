"""Is a live frame a picture of what is there? Frozen, blank or late ones steer no exposure."""

from __future__ import annotations

import numpy as np

from perception.values import Bytes

#: Pixels compared, every so many both ways.
_EVERY = 8
#: Two frames that differ by less on average (grey) are one and the same: noise alone makes more.
SAME_GREY = 0.02
#: So many in a row are a frozen stream; one may be the encoder's.
FROZEN_FRAMES = 2
#: A picture with less spread (sd, grey) shows nothing.
BLANK_SD = 1.5
#: A blank picture that stays so long may be a scene far out of range after all.
BLANK_S = 1.0
LATE_S = 1.0


class FrameCheck:
    """Judges frames as they come."""

    def __init__(self) -> None:
        """Start without a frame."""
        self._last: Bytes | None = None
        self._same = 0
        self._blank_since_s: float | None = None

    def usable(self, grey: Bytes, stamp_s: float, now_s: float) -> bool:
        """Return whether a frame (H, W) may steer the exposure.

        ``stamp_s``: when it was taken; ``now_s``: newest mission time known from elsewhere.
        """
        thinned = np.ascontiguousarray(grey[::_EVERY, ::_EVERY])
        last, self._last = self._last, thinned
        if last is not None and last.shape == thinned.shape:
            change = float(np.abs(thinned.astype(np.int16) - last).mean())
            self._same = self._same + 1 if change < SAME_GREY else 0
        else:
            self._same = 0
        blank = float(thinned.std()) < BLANK_SD
        if not blank:
            self._blank_since_s = None
        elif self._blank_since_s is None or stamp_s < self._blank_since_s:
            self._blank_since_s = stamp_s
        if now_s - stamp_s > LATE_S:
            return False
        if blank:
            # A frozen blank is one that stays, not a frozen scene.
            return self._blank_since_s is not None and stamp_s - self._blank_since_s >= BLANK_S
        return self._same < FROZEN_FRAMES
