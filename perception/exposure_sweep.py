"""A few exposures for the camera's sake: its curve learned to both ends before they are needed.

A tone curve is known where pictures have shown it. The light's first large change would find its
ends unknown, and be answered too far or not far enough. So once, while no photo is near, the blade
is shown too bright and too dark for a moment each; the response learns from every change.
"""

from __future__ import annotations

#: EV beside the right one, one after the other.
OFFSETS_EV = (1.7, -2.0, 2.7)
#: Frames with an exposure before the next is tried; the response wants one after the change.
FRAMES = 3
#: Frames in a row that show the exposure asked for before it begins.
SETTLED_FRAMES = 4
#: An exposure that does not show after so long (s) is left.
MOST_S = 1.2


class Sweep:
    """Tells by how much to miss the right exposure; once in the life of a controller."""

    def __init__(self) -> None:
        self._step = -1
        self._frames = 0
        self._since_s = 0.0

    @property
    def done(self) -> bool:
        """Whether it is over, or was cut short."""
        return self._step >= len(OFFSETS_EV)

    @property
    def under_way(self) -> bool:
        """Whether exposures are being tried now."""
        return 0 <= self._step < len(OFFSETS_EV)

    def offset_ev(self, stamp_s: float, *, spare: bool, settled: bool) -> float:
        """Return by how many EV to miss the right exposure after a frame.

        ``spare``: no photo is near; ``settled``: the frame was exposed as was last asked for.
        """
        if self.done:
            return 0.0
        if not spare:
            if self.under_way:
                self._step = len(OFFSETS_EV)
            self._frames = 0
            return 0.0
        self._frames = self._frames + 1 if settled else 0
        if not self.under_way:
            if self._frames < SETTLED_FRAMES:
                return 0.0
            self._next(stamp_s)
        elif self._frames >= FRAMES or stamp_s - self._since_s > MOST_S:
            self._next(stamp_s)
        return OFFSETS_EV[self._step] if self.under_way else 0.0

    def _next(self, stamp_s: float) -> None:
        self._step += 1
        self._frames, self._since_s = 0, stamp_s
