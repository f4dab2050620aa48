"""How punctual the control loop has been in the last second; for metrics and the console."""

from __future__ import annotations

import statistics
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
        self._gaps_ms: list[float] = []

    def begin(self) -> None:
        """A new mission begins."""
        self._gaps_ms.clear()

    def gap(self, now_s: float, gap_ms: float) -> None:
        """Note the time between two setpoints."""
        self._gaps_ms.append(gap_ms)
        self.gap_ms.note(now_s, gap_ms)

    def spread(self) -> dict[str, float]:
        """Return median, 99th percentile and most of the mission's gaps; empty before two."""
        gaps = sorted(self._gaps_ms)
        if len(gaps) < 2:
            return {}
        return {
            "p50": statistics.median(gaps),
            "p99": gaps[min(len(gaps) - 1, round(0.99 * len(gaps)))],
            "max": gaps[-1],
        }
