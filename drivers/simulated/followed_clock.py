"""World time that follows another simulator's: its boot time, smoothed into an even pace."""

from __future__ import annotations

import time

from drivers.clock import SharedClockWriter

_JUMP_S = 0.5
_SILENT_S = 0.3
_WINDOW_S = 0.1
_PULL_PER_S = 2.0
_PACE_S = 1.0
_SLOWEST = 0.05
_FASTEST = 20.0


class FollowedClock:
    """Steers the shared clock by stamps of another clock as they arrive."""

    def __init__(self, clock: SharedClockWriter) -> None:
        self._clock = clock
        self._mark: tuple[float, float] | None = None
        self._pace = 1.0
        self._steady = False
        self._heard_s = 0.0

    def take(self, boot_s: float, monotonic_s: float | None = None) -> None:
        """Take a stamp that has just arrived."""
        now_s = time.monotonic() if monotonic_s is None else monotonic_s
        self._heard_s = now_s
        ahead_s = boot_s - self._clock.now_s()
        if self._mark is None or abs(ahead_s) > _JUMP_S:
            self._clock.set_now(boot_s)
            self._clock.set_factor(1.0)
            self._mark = (boot_s, now_s)
            return
        boot_0, now_0 = self._mark
        passed_s = now_s - now_0
        if passed_s < _WINDOW_S:
            if self._clock.factor() == 0.0:
                self._clock.set_factor(max(self._pace, _SLOWEST))
            return
        # A pace over a second or so, and what brings the two clocks together in half a second.
        share = min(passed_s / _PACE_S, 1.0) if self._steady else 1.0
        self._pace += share * ((boot_s - boot_0) / passed_s - self._pace)
        self._steady = True
        self._clock.set_factor(min(max(self._pace + _PULL_PER_S * ahead_s, 0.0), _FASTEST))
        self._mark = (boot_s, now_s)

    def watch(self) -> None:
        """Stand still while the other simulator is silent."""
        if time.monotonic() - self._heard_s > _SILENT_S and self._clock.factor() > 0:
            self._clock.set_factor(0.0)
