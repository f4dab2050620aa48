"""What the renderer hands its sensor data to: the wire's twins or the bus."""

from __future__ import annotations

from typing import Protocol

from config.simulation import Word
from drivers.simulated.scanner import RawScan
from perception.values import Bytes


class ScanSink(Protocol):
    """Takes the rays of one scan period after the other."""

    @property
    def wanted(self) -> bool:
        """Whether the sensor measures; while not, rays need not be cast."""
        ...

    def send(self, scan: RawScan) -> None:
        """Take a period's rays in firing order."""
        ...

    def unsent_since_s(self) -> float | None:
        """Return the mission time of the oldest data that has not left, None for none."""
        ...

    def set_fault(self, word: Word) -> None:
        """Play a failure word from now on (`ok` ends it)."""
        ...

    def close(self) -> None:
        """Let go of sockets and threads."""
        ...


class FrameSink(Protocol):
    """Takes the live stream's pictures."""

    def send(self, t_s: float, grey: Bytes) -> None:
        """Take an (H, W) picture exposed at mission time ``t_s``."""
        ...

    def close(self) -> None:
        """Let go of sockets and threads."""
        ...
