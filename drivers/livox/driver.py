"""The MID-360 as the rest of bladescout sees it: an asyncio task that hands over scans."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from config.sensors import Lidar
from drivers.clock import Clock
from drivers.livox.receiver import ImuReading, Receiver
from drivers.livox.statistics import Statistics
from perception.values import Scan


class Mid360Driver:
    """Finds, configures and reads one MID-360, and does it all again when it falls silent.

    Args:
        settings: where the sensor is; its `lidar_ip` empty: it is searched for by broadcast.
        clock: mission time.
        on_imu: called on the loop with the readings of a few milliseconds.
    """

    def __init__(
        self,
        settings: Lidar,
        clock: Clock,
        on_imu: Callable[[tuple[ImuReading, ...]], None] | None = None,
    ) -> None:
        self._settings = settings
        self._clock = clock
        self._on_imu = on_imu
        self._receiver: Receiver | None = None
        self._resting = False

    def rest(self, resting: bool) -> None:
        """Set whether a scan a second is enough, at next to no cost; at first all are read."""
        self._resting = resting
        if self._receiver is not None:
            self._receiver.resting = resting

    @property
    def statistics(self) -> Statistics:
        """Counts and state since `run` was called."""
        return Statistics() if self._receiver is None else self._receiver.statistics

    async def run(self, on_scan: Callable[[Scan], None]) -> None:
        """Receive until cancelled; ``on_scan`` is called on the loop for each scan."""
        loop = asyncio.get_running_loop()

        def on_loop(call: Callable[..., None], *values: object) -> None:
            # The loop may be closed before the thread has noticed that it is to stop.
            if not loop.is_closed():
                loop.call_soon_threadsafe(call, *values)

        on_imu = self._on_imu
        receiver = Receiver(
            self._settings,
            self._clock,
            lambda scan: on_loop(on_scan, scan),
            None if on_imu is None else lambda readings: on_loop(on_imu, readings),
        )
        receiver.resting = self._resting
        self._receiver = receiver
        with ThreadPoolExecutor(1, thread_name_prefix="mid360") as pool:
            receiving = loop.run_in_executor(pool, receiver.run)
            try:
                await asyncio.shield(receiving)
            finally:
                receiver.stop()  # the pool then waits for a nap of 4 ms at most
