"""The vehicle's link as a `.tlog`: each MAVLink frame behind its UTC time, as ground stations do.

What pymavlink, QGroundControl and Mission Planner read: for every frame the microseconds
since 1970 as eight bytes, the highest first, and then its bytes as they were on the wire.
"""

from __future__ import annotations

import struct
import time
from pathlib import Path

from drivers.autopilot_tap import frames
from mission.records.spool import Spool

_TIME = struct.Struct(">Q")
#: Handed to the kernel at least so often: what a kill may cost.
FLUSH_S = 0.3


class LinkLog:
    """An open `.tlog`. Not thread-safe; a disk that fails raises nothing: `lost` tells of it."""

    def __init__(self, path: Path) -> None:
        self._spool = Spool(path)
        self._flushed_s = time.monotonic()
        self._fault = ""
        self.frames = 0

    def add(self, data: bytes, utc_ns: int) -> None:
        """Append the frames of one datagram as they came at a moment (UTC)."""
        head = _TIME.pack(utc_ns // 1000)
        for frame in frames(data):
            self._spool.write(head + frame)
            self.frames += 1
        now_s = time.monotonic()
        if now_s - self._flushed_s >= FLUSH_S:
            self._flushed_s = now_s
            self._spool.flush()
            self._fault = self._spool.fault or self._fault

    def lost(self) -> tuple[str, ...]:
        """Return what the file lacks, in words; empty: nothing."""
        if not self._spool.ended:
            return ()
        return (f"the MAVLink log is cut short: {self._spool.fault or self._fault}",)

    def close(self) -> None:
        """Write what is left."""
        self._spool.close()
