"""Tells a sensor that started anew from one that repeats itself or makes times up."""

from __future__ import annotations

#: Sensor time that must pass steadily before it is believed.
_CONFIRM_NS = 500_000_000
_STEP_NS = 100_000_000
_REORDERED_NS = 20_000_000


class NewEpoch:
    """Watches packets whose time does not follow on, until they follow each other for 0.5 s.

    A sensor that was rebooted counts from zero, one that was synchronised leaps: both then go on
    steadily. One that sends the same packets over and over falls back each time.
    """

    def __init__(self) -> None:
        self._first_ns: int | None = None
        self._last_ns = 0

    def clear(self) -> None:
        """Forget the candidate: time went on as before."""
        self._first_ns = None

    def confirms(self, stamp_ns: int) -> bool:
        """Take in a stamp out of time; return whether a new epoch is certain."""
        step_ns = stamp_ns - self._last_ns
        if self._first_ns is None or not -_REORDERED_NS < step_ns < _STEP_NS:
            self._first_ns = self._last_ns = stamp_ns
            return False
        self._last_ns = max(self._last_ns, stamp_ns)
        return self._last_ns - self._first_ns >= _CONFIRM_NS
