"""How regularly set-points reach the autopilot: gaps between arrivals while it flies OFFBOARD."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Gaps:
    """Percentiles of gaps, milliseconds."""

    p50: float
    p99: float
    max: float
    count: int

    def as_json(self) -> dict[str, float]:
        """Return the fields by name."""
        return asdict(self)


class SetpointTiming:
    """Collects arrivals in mission and wall time."""

    def __init__(self) -> None:
        self._last: tuple[float, int] | None = None
        self._mission_ms: list[float] = []
        self._wall_ms: list[float] = []
        self.count = 0
        self.last_s: float | None = None
        """Mission time of the newest arrival, in whatever mode."""

    def arrived(self, mission_s: float, monotonic_ns: int, *, offboard: bool) -> None:
        """Note one arrival; only gaps that began and ended in OFFBOARD count."""
        self.count += 1
        self.last_s = mission_s
        if self._last is not None and offboard:
            self._mission_ms.append((mission_s - self._last[0]) * 1e3)
            self._wall_ms.append((monotonic_ns - self._last[1]) * 1e-6)
        self._last = (mission_s, monotonic_ns) if offboard else None

    def gaps(self) -> tuple[Gaps, Gaps]:
        """Return the gaps in mission time and in wall time."""
        return _gaps(self._mission_ms), _gaps(self._wall_ms)


def _gaps(values_ms: list[float]) -> Gaps:
    if not values_ms:
        return Gaps(0.0, 0.0, 0.0, 0)
    p50, p99 = np.percentile(values_ms, (50, 99))
    return Gaps(
        round(float(p50), 3), round(float(p99), 3), round(max(values_ms), 3), len(values_ms)
    )
