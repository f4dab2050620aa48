"""What the renderer hands its sensor data to: the wire's twins or the bus."""

from __future__ import annotations

from typing import Protocol

from perception.values import Bytes, Float, Float32


class ScanSink(Protocol):
    """Takes the returns of one scan period."""

    def send(
        self,
        t0_s: float,
        points_l: Float32,
        offsets_s: Float,
        reflectivity: Bytes,
        tag: Bytes,
    ) -> None:
        """Take rays in firing order.

        ``t0_s``: mission time of the first ray; ``points_l``: (N, 3) metres, LiDAR FLU, zero where
        nothing came back; ``offsets_s``: (N,) seconds after ``t0_s``; ``reflectivity``, ``tag``:
        (N,).
        """
        ...

    def set_fault(self, word: str) -> None:
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
