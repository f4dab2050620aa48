"""World time that follows another simulator's: its boot time, smoothed into an even pace.

It counts from the first stamp: the other simulator may have run for days. Where its own time starts
anew (a reboot), ours goes on from where it was.
"""

from __future__ import annotations

import time

from drivers.clock import SharedClockWriter

_JUMP_S = 0.5
_SILENT_S = 0.3
_WINDOW_S = 0.1
_PULL_PER_S = 2.0
_PACE_S = 1.0
_SLOWEST = 0.05
_GROWTH, _PACE_AT_LEAST = 2.0, 0.5
_FASTEST = 20.0


class FollowedClock:
    """Steers the shared clock by stamps of another clock as they arrive."""

    def __init__(self, clock: SharedClockWriter) -> None:
        self._clock = clock
        self._mark: tuple[float, float] | None = None
        self._pace = 1.0
        self._steady = False
        self._heard_s = 0.0
        self._zero_s: float | None = None
        self._newest_s = 0.0

    def world_s(self, boot_s: float) -> float:
        """Return the world time of a stamp."""
        return boot_s - (boot_s if self._zero_s is None else self._zero_s)

    def take(self, boot_s: float, monotonic_s: float | None = None) -> None:
        """Take a stamp that has just arrived."""
        now_s = time.monotonic() if monotonic_s is None else monotonic_s
        self._heard_s = now_s
        world_s = self._clock.now_s()
        if self._zero_s is None or boot_s < self._newest_s - _JUMP_S:
            self._zero_s, self._mark, self._newest_s = boot_s - world_s, None, boot_s
        self._newest_s = max(self._newest_s, boot_s)
        ahead_s = boot_s - self._zero_s - world_s
        if self._mark is None or abs(ahead_s) > _JUMP_S:
            self._clock.set_now(boot_s - self._zero_s)
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
        # Stamps that waited come in a heap: no pace is believed that is more than twice the last.
        told = min((boot_s - boot_0) / passed_s, _GROWTH * max(self._pace, _PACE_AT_LEAST))
        self._pace += share * (told - self._pace)
        self._steady = True
        self._clock.set_factor(min(max(self._pace + _PULL_PER_S * ahead_s, 0.0), _FASTEST))
        self._mark = (boot_s, now_s)

    def watch(self) -> None:
        """Stand still while the other simulator is silent."""
        if time.monotonic() - self._heard_s > _SILENT_S and self._clock.factor() > 0:
            self._clock.set_factor(0.0)
