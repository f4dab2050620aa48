"""The sensing process: LiDAR and camera drivers as concurrent tasks, perception in workers beside.

The drivers only receive, decode and publish; every fit runs in a worker process, so that no
packet waits for it.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from drivers.bus import Bus, Key
from drivers.clock import sleep
from drivers.codecs import COMPRESSED_IMAGE, POINT_CLOUD, encode_frame, encode_scan
from drivers.livox.driver import Mid360Driver
from drivers.video import VideoStream
from mission.processes.children import Child
from mission.processes.rest import Rest
from mission.processes.runtime import Runtime, run_process
from mission.remote.messages import SensingHealth
from perception.values import Frame, Scan

log = logging.getLogger(__name__)

_WORKERS = (
    ("tracking", "mission.processes.tracking_worker"),
    ("estimation", "mission.processes.estimation_worker"),
)
HEALTH_PERIOD_S = 1.0
ONLINE_WITHIN_S = 2.0
#: After a rest pictures may be waited for so long: they begin with the next key picture.
AWAKE_S = 6.0
#: A stream of which nothing could be decoded for so long does not count as coming.
KEY_WITHIN_S = 30.0


@dataclass(slots=True)
class _Counts:
    scans: int = 0
    frames: int = 0
    last_scan_s: float = float("-inf")
    last_frame_s: float = float("-inf")
    rest: Rest | None = None
    stream_heard_s: Callable[[], float] | None = None

    def seen_s(self, now_s: float) -> float:
        """Return when the live picture was last seen to come, decoded or, at rest, not."""
        if self.rest is None or self.stream_heard_s is None:
            return self.last_frame_s
        rested = self.rest.resting or now_s - self.rest.woke_s < AWAKE_S
        if not rested or now_s - self.last_frame_s > KEY_WITHIN_S:
            return self.last_frame_s
        return max(self.last_frame_s, self.stream_heard_s())


async def sense(runtime: Runtime) -> None:
    """Run drivers and worker until cancelled."""
    with runtime.open_bus() as bus:
        counts = _Counts()
        workers = [Child(name, module, runtime.run_dir) for name, module in _WORKERS]

        def on_death(name: str, deaths: int) -> None:
            log.error("the %s worker died %d times within a minute", name, deaths)

        tasks = [asyncio.create_task(_report_health(runtime, bus, counts))]
        tasks += [asyncio.create_task(worker.keep_alive(on_death)) for worker in workers]
        for name, driver in _drivers(runtime, bus, counts):
            tasks.append(asyncio.create_task(_keep_running(name, driver)))
        try:
            await asyncio.gather(*tasks)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await asyncio.gather(*(worker.end(patience_s=2.0) for worker in workers))


def _drivers(
    runtime: Runtime, bus: Bus, counts: _Counts
) -> list[tuple[str, Callable[[], Awaitable[None]]]]:
    settings, clock = runtime.settings, runtime.clock

    def on_scan(scan: Scan) -> None:
        counts.scans += 1
        counts.last_scan_s = clock.now_s()
        payload, attachment = encode_scan(scan)
        bus.publish(Key.SCAN, payload, encoding=POINT_CLOUD, attachment=attachment, droppable=True)

    def on_frame(frame: Frame) -> None:
        counts.frames += 1
        counts.last_frame_s = clock.now_s()
        payload, attachment = encode_frame(frame)
        bus.publish(
            Key.FRAME, payload, encoding=COMPRESSED_IMAGE, attachment=attachment, droppable=True
        )

    rest = Rest(bus, clock)
    drivers: list[tuple[str, Callable[[], Awaitable[None]]]] = []
    if settings.lidar.source == "livox":
        lidar = Mid360Driver(settings.lidar, clock)
        rest.tell(lidar.rest)
        drivers.append(("lidar", lambda: lidar.run(on_scan)))
    else:
        bus.subscribe_newest(Key.SCAN, lambda _: _count_scan(counts, clock.now_s()))
    if settings.camera.source == "rtsp":
        stream = VideoStream(
            settings.camera.stream_url,
            clock,
            timeout_s=settings.camera.stream_timeout_s,
            rate_hz=settings.camera.live_rate_hz,
            width_px=settings.camera.live_width_px,
        )
        counts.stream_heard_s = lambda: clock.mission_time_of(stream.heard_ns)
        counts.rest = rest
        rest.tell(stream.rest)
        drivers.append(("camera", lambda: stream.run(on_frame)))
    else:
        bus.subscribe_newest(Key.FRAME, lambda _: _count_frame(counts, clock.now_s()))
    return drivers


def _count_scan(counts: _Counts, now_s: float) -> None:
    counts.scans, counts.last_scan_s = counts.scans + 1, now_s


def _count_frame(counts: _Counts, now_s: float) -> None:
    counts.frames, counts.last_frame_s = counts.frames + 1, now_s


async def _keep_running(name: str, driver: Callable[[], Awaitable[None]]) -> None:
    """Start a driver again when it ends by an error of its device."""
    while True:
        try:
            await driver()
        except OSError as error:
            log.error("%s: %s; trying again", name, error)
        await asyncio.sleep(1.0)


async def _report_health(runtime: Runtime, bus: Bus, counts: _Counts) -> None:
    while True:
        now_s = runtime.clock.now_s()
        health = SensingHealth(
            mission_s=now_s,
            lidar_online=now_s - counts.last_scan_s < ONLINE_WITHIN_S,
            camera_online=now_s - counts.seen_s(now_s) < ONLINE_WITHIN_S,
            scans=counts.scans,
            frames=counts.frames,
            dropped=bus.dropped,
        )
        bus.publish(Key.SENSING, health.model_dump_json().encode())
        await sleep(runtime.clock, HEALTH_PERIOD_S)


if __name__ == "__main__":
    run_process("sensing", sense, niceness=-6)
