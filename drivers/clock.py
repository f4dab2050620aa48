"""Mission time: the one clock that everything waits on.

On the aircraft it is the monotonic clock. In simulation it runs at a factor that the field may
change: the field writes an anchor (mission time, monotonic time, factor) into a small mapped file
and every process of the simulation computes mission time from it.
"""

from __future__ import annotations

import asyncio
import mmap
import struct
import time
from pathlib import Path
from typing import Protocol

_ANCHOR = struct.Struct("<QdqdQ")  # count, mission s, monotonic ns, factor, count again
_SIZE = 64


class Clock(Protocol):
    """Mission time and waiting in it."""

    def now_s(self) -> float:
        """Return mission time in seconds."""
        ...

    def factor(self) -> float:
        """Return mission seconds per wall second."""
        ...

    def mission_time_of(self, monotonic_ns: int) -> float:
        """Return the mission time at a monotonic time stamp."""
        ...


class MonotonicClock:
    """The aircraft's clock: monotonic seconds, factor 1. Steps of UTC do not move it."""

    def now_s(self) -> float:
        """Return mission time in seconds."""
        return time.monotonic_ns() * 1e-9

    def factor(self) -> float:
        """Return 1."""
        return 1.0

    def mission_time_of(self, monotonic_ns: int) -> float:
        """Return the mission time at a monotonic time stamp."""
        return monotonic_ns * 1e-9


class SharedClock:
    """A reader of the simulation's clock file."""

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            self._map = mmap.mmap(file.fileno(), _SIZE, access=mmap.ACCESS_READ)

    def _anchor(self) -> tuple[float, int, float]:
        while True:
            before, mission_s, monotonic_ns, factor, after = _ANCHOR.unpack_from(self._map)
            if before == after:
                return mission_s, monotonic_ns, factor

    def now_s(self) -> float:
        """Return mission time in seconds."""
        return self.mission_time_of(time.monotonic_ns())

    def factor(self) -> float:
        """Return mission seconds per wall second."""
        return self._anchor()[2]

    def mission_time_of(self, monotonic_ns: int) -> float:
        """Return the mission time at a monotonic time stamp, by the newest anchor."""
        mission_s, anchor_ns, factor = self._anchor()
        return mission_s + (monotonic_ns - anchor_ns) * 1e-9 * factor


class SharedClockWriter:
    """The field's end of the clock file."""

    def __init__(self, path: Path, factor: float, start_s: float = 0.0) -> None:
        path.write_bytes(b"\0" * _SIZE)
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), _SIZE)
        self._count = 0
        self._mission_s, self._ns, self._factor = start_s, time.monotonic_ns(), factor
        self._write()

    def _write(self) -> None:
        self._count += 1
        # The trailing count is written first and the leading one last: a torn read differs.
        struct.pack_into("<Q", self._map, _ANCHOR.size - 8, self._count)
        struct.pack_into("<dqd", self._map, 8, self._mission_s, self._ns, self._factor)
        struct.pack_into("<Q", self._map, 0, self._count)

    def now_s(self) -> float:
        """Return mission time in seconds."""
        return self.mission_time_of(time.monotonic_ns())

    def factor(self) -> float:
        """Return mission seconds per wall second."""
        return self._factor

    def mission_time_of(self, monotonic_ns: int) -> float:
        """Return the mission time at a monotonic time stamp."""
        return self._mission_s + (monotonic_ns - self._ns) * 1e-9 * self._factor

    def set_factor(self, factor: float) -> None:
        """Go on from now at another factor (0 pauses the world)."""
        now_ns = time.monotonic_ns()
        self._mission_s, self._ns = self.mission_time_of(now_ns), now_ns
        self._factor = factor
        self._write()

    def set_now(self, mission_s: float) -> None:
        """Move the anchor, to follow another simulator's time."""
        self._mission_s, self._ns = mission_s, time.monotonic_ns()
        self._write()


async def sleep_until(clock: Clock, mission_s: float) -> None:
    """Wait until a mission time, following changes of the factor."""
    while (left_s := mission_s - clock.now_s()) > 0:
        factor = clock.factor()
        await asyncio.sleep(min(left_s / factor, 0.25) if factor > 0 else 0.02)


async def sleep(clock: Clock, duration_s: float) -> None:
    """Wait for a duration of mission time."""
    await sleep_until(clock, clock.now_s() + duration_s)
