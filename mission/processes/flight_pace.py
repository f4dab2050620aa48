"""How punctual the control loop has been in the last second; for metrics and the console."""

from __future__ import annotations

from collections import deque

WINDOW_S = 1.0


class Worst:
    """The largest of the values noted within the last second."""

    def __init__(self) -> None:
        self._noted: deque[tuple[float, float]] = deque()

    def note(self, now_s: float, value: float) -> None:
        """Note a value at a mission time."""
        self._noted.append((now_s, value))
        self._forget(now_s)

    def worst(self, now_s: float) -> float | None:
        """Return the largest; None: nothing was noted."""
        self._forget(now_s)
        return max((value for _, value in self._noted), default=None)

    def _forget(self, now_s: float) -> None:
        while self._noted and now_s - self._noted[0][0] > WINDOW_S:
            self._noted.popleft()


class Pace:
    """Lag of the ticks and gaps between setpoints, milliseconds of mission time."""

    def __init__(self) -> None:
        self.lag_ms = Worst()
        self.gap_ms = Worst()
