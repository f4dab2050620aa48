"""The rate of the light: a ramp is carried on over the latency, a step is not.

The slope over the newest frames is compared with the slope before it, and the smaller of the two
counts (minmod): a step is one large change with nothing beside it, so that it never looks like a
ramp, while a ramp is known from its second frame on. Over several widths, from the shortest that
stands out of the noise.
"""

from __future__ import annotations

from collections import deque

#: Frames compared with as many before them.
WIDTHS = (1, 2, 4, 8)
#: A slope counts when its change over the width is beyond so many sigmas of the noise, and this.
SIGMAS, LEAST_EV = 4.0, 0.05
MAX_RATE_EV_PER_S = 6.0
#: Share of the trend carried on. All of it would lag nothing and overshoot most when a ramp ends.
GAIN = 0.75
MAX_AHEAD_EV = 1.0
_NOISE_KEPT = 0.95
_BREAK_S = 0.5


class Trend:
    """Rate of the light in EV/s."""

    def __init__(self) -> None:
        """Start at rest."""
        self._values: deque[tuple[float, float]] = deque(maxlen=2 * WIDTHS[-1] + 1)
        self._noise_ev = 0.02

    @property
    def noise_ev(self) -> float:
        """Sigma of a frame's light about its neighbours."""
        return self._noise_ev

    def reset(self) -> None:
        """Forget the trend; a frame that only bounds the light breaks it."""
        self._values.clear()

    def update(self, stamp_s: float, light_ev: float) -> None:
        """Take in the light (EV) of a frame."""
        if self._values and not 0 < stamp_s - self._values[-1][0] < _BREAK_S:
            self._values.clear()
        self._values.append((stamp_s, light_ev))
        if len(self._values) >= 3:
            (_, a), (_, b), (_, c) = list(self._values)[-3:]
            # Of a second difference, 6 ** 0.5 times the noise; steps must not count as noise.
            second = min(abs(c - 2 * b + a), 4.0 * self._noise_ev + 0.02)
            self._noise_ev = max(
                0.005, _NOISE_KEPT * self._noise_ev + (1 - _NOISE_KEPT) * second / 1.95
            )

    def rate(self, doubt_ev_per_s: float = 0.0) -> float:
        """Return the rate in EV/s, 0 where nothing stands out.

        ``doubt_ev_per_s``: so much of a rate may be something else's.
        """
        values = list(self._values)
        for width in WIDTHS:
            if len(values) < 2 * width + 1:
                break
            (t2, c), (t1, b), (t0, a) = values[-1], values[-1 - width], values[-1 - 2 * width]
            new, old = (c - b) / (t2 - t1), (b - a) / (t1 - t0)
            if new * old <= 0:
                continue
            slope = min(abs(new), abs(old))
            if slope * (t2 - t1) > max(SIGMAS * self._noise_ev, LEAST_EV):
                left = max(min(slope, MAX_RATE_EV_PER_S) - doubt_ev_per_s, 0.0)
                return left * (1.0 if new > 0 else -1.0)
        return 0.0

    def ahead(self, lead_s: float, doubt_ev_per_s: float = 0.0) -> float:
        """Return by how much (EV) the light is expected to have changed after a time."""
        change_ev = GAIN * self.rate(doubt_ev_per_s) * lead_s
        return min(max(change_ev, -MAX_AHEAD_EV), MAX_AHEAD_EV)
