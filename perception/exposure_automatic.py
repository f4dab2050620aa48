"""The camera's own automatic, where EV only biases it.

It meters the whole picture and moves towards its own idea of it, so that after every change of the
light it works against what the blade needs, or does part of the work itself. The same whole
picture is at hand here: what its light lacks to the automatic's aim is what the automatic will
still do, with a time constant. Aim and time constant are learned.
"""

from __future__ import annotations

import math

#: 1/s of an automatic that was not yet seen at work, and the evidence that this counts for.
_USUAL_RATE = 2.0
_USUAL_WEIGHT = 0.02
_LEAST_RATE, _MOST_RATE = 0.0, 12.0
#: The aim follows the settled picture over this time.
_AIM_S = 1.5
#: A picture off the aim by less than this (EV) says nothing about the time constant.
_WORTH_EV = 0.25
_KEPT = 0.98
#: Light, not the automatic, when the picture changes by more than this (EV/s).
_LIGHT_EV_PER_S = 12.0


class Automatic:
    """First-order model of an automatic exposure; does nothing for a camera without one."""

    def __init__(self, *, present: bool) -> None:
        """``present``: EV biases an automatic; otherwise it is absolute."""
        self._present = present
        self._aim_ev: float | None = None
        self._evidence = _USUAL_WEIGHT
        self._side = _USUAL_WEIGHT * _USUAL_RATE
        self._last: tuple[float, float] | None = None

    @property
    def rate(self) -> float:
        """1/s: inverse of the time constant."""
        return min(max(self._side / self._evidence, _LEAST_RATE), _MOST_RATE)

    def update(self, whole_ev: float, stamp_s: float) -> None:
        """Take in a frame.

        ``whole_ev``: log2 of the mean light of the whole picture, less the bias it was exposed
        with: what the automatic alone made of it.
        """
        if not self._present:
            return
        if self._last is not None and 0 < stamp_s - self._last[0] < 0.5:
            self._learn(whole_ev, stamp_s - self._last[0], self._last[1])
        elif self._aim_ev is None:
            self._aim_ev = whole_ev
        self._last = (stamp_s, whole_ev)

    def recalibrate(self, shift_ev: float) -> None:
        """Move what is remembered by what a corrected curve makes of it."""
        if self._last is not None:
            self._last = (self._last[0], self._last[1] + shift_ev)
        if self._aim_ev is not None:
            self._aim_ev += shift_ev

    def ahead(self, lead_s: float) -> float:
        """Return by how much (EV) the automatic will have changed the exposure after a time."""
        if not self._present or self._last is None or self._aim_ev is None:
            return 0.0
        return (self._aim_ev - self._last[1]) * (1.0 - math.exp(-self.rate * lead_s))

    def pace(self) -> float:
        """Return how fast (EV/s) it changes the exposure now."""
        if not self._present or self._last is None or self._aim_ev is None:
            return 0.0
        return (self._aim_ev - self._last[1]) * self.rate

    def _learn(self, whole_ev: float, passed_s: float, before_ev: float) -> None:
        aim_ev = before_ev if self._aim_ev is None else self._aim_ev
        change, off = whole_ev - before_ev, aim_ev - before_ev
        if abs(change) > max(_LIGHT_EV_PER_S * passed_s, 0.3):
            return
        # Exact for a first-order automatic: the share of the way that was gone.
        if abs(off) > _WORTH_EV and -0.2 < change / off < 0.98:
            rate = -math.log(max(1.0 - change / off, 0.02)) / passed_s
            weight = off * off
            self._evidence = _KEPT * self._evidence + weight
            self._side = _KEPT * self._side + weight * max(rate, 0.0)
        # Where the picture rests is the aim; while it moves it is not.
        resting = math.exp(-((change / passed_s) ** 2) / 0.08)
        self._aim_ev = aim_ev + resting * min(1.0, passed_s / _AIM_S) * (whole_ev - aim_ev)
