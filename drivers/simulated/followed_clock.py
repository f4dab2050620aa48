"""World time that follows another simulator's: its boot time, smoothed into an even pace."""

from __future__ import annotations

import time

from drivers.clock import SharedClockWriter

_JUMP_S = 0.5
_SILENT_S = 0.3
_WINDOW_S = 0.25
_PULL_PER_S = 2.0
_FASTEST = 20.0


class FollowedClock:
    """Steers the shared clock by stamps of another clock as they arrive."""

    def __init__(self, clock: SharedClockWriter) -> None:
        self._clock = clock
        self._mark: tuple[float, float] | None = None
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
        if now_s - now_0 < _WINDOW_S:
            if self._clock.factor() == 0.0:
                self._clock.set_factor(1.0)
            return
        pace = (boot_s - boot_0) / (now_s - now_0)
        self._clock.set_factor(min(max(pace + _PULL_PER_S * ahead_s, 0.0), _FASTEST))
        self._mark = (boot_s, now_s)

    def watch(self) -> None:
        """Stand still while the other simulator is silent."""
        if time.monotonic() - self._heard_s > _SILENT_S and self._clock.factor() > 0:
            self._clock.set_factor(0.0)
