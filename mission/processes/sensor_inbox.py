"""What the perception workers share: scans, poses and the task, as they come over the bus."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections import deque
from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np
from pydantic import TypeAdapter

from drivers.bus import Bus, Key, Sample
from drivers.clock import Clock
from drivers.codecs import BadMessage, decode_scan
from mission.flight.command import SensingMode, SensingTask
from mission.flight.observation import CameraState, GimbalState
from mission.remote.messages import ReadyMessage, TakenMessage, VehicleMessage
from perception.values import Pose, Scan

log = logging.getLogger(__name__)

#: A scan waits at most this long for the pose of its newest point.
MAX_POSE_WAIT_S = 0.1
_TASK = TypeAdapter(SensingTask)
Worker: TypeAlias = Literal["tracking", "estimation"]


class SensorInbox:
    """Newest scan, recent poses, gimbal and camera states, and the sensing task."""

    def __init__(self, bus: Bus, clock: Clock) -> None:
        self._bus = bus
        self._clock = clock
        self._scan: Scan | None = None
        self._news = asyncio.Event()
        self.poses: deque[Pose] = deque(maxlen=120)
        self.gimbals: deque[GimbalState] = deque(maxlen=120)
        self.cameras: deque[CameraState] = deque(maxlen=120)
        self.task = SensingTask(SensingMode.IDLE, 0)
        self.bad_messages = 0
        bus.subscribe(Key.VEHICLE, self._take_vehicle)
        bus.subscribe(Key.TASK, self._take_task)
        bus.subscribe_newest(Key.SCAN, self._take_scan)

    async def next_scan(self) -> Scan:
        """Return the newest scan, once its newest point's pose is known (or will not come)."""
        while True:
            scan = self._scan
            if scan is not None:
                posed = bool(self.poses) and self.poses[-1].stamp_s >= scan.stamp_s
                if posed or self._clock.now_s() - scan.stamp_s > MAX_POSE_WAIT_S:
                    self._scan = None
                    return scan
            self._news.clear()
            with contextlib.suppress(TimeoutError):
                # Only a scan that waits for its pose must be looked at again by itself.
                await asyncio.wait_for(self._news.wait(), None if scan is None else 0.02)

    async def work(self, name: Worker, take: Callable[[Scan], None]) -> None:
        """Hand the newest scan to a worker, again and again, until cancelled; tell it is ready."""
        ready = asyncio.create_task(self._say_ready(name))
        try:
            while True:
                scan = await self.next_scan()
                self.tell_taken(name, "scan", scan.stamp_s)
                take(scan)
                await asyncio.sleep(0)
        finally:
            ready.cancel()

    async def _say_ready(self, name: str) -> None:
        """Tell flight, again and again, that this worker can work."""
        message = ReadyMessage(name=name).model_dump_json().encode()
        while True:
            self._bus.publish(Key.READY, message)
            await asyncio.sleep(1.0)

    def tell_taken(self, worker: Worker, what: Literal["scan", "frame"], stamp_s: float) -> None:
        """Tell the recorder what is taken up, and what is known meanwhile."""
        message = TakenMessage(
            worker=worker,
            what=what,
            stamp_s=stamp_s,
            pose_s=self.poses[-1].stamp_s if self.poses else None,
            task_id=self.task.task_id,
        )
        self._bus.publish(Key.TAKEN, message.model_dump_json().encode(), droppable=True)

    def position(self) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]] | None:
        """Return where the vehicle was last, (3,) world."""
        return self.poses[-1].position_w if self.poses else None

    def _take_vehicle(self, sample: Sample) -> None:
        message = VehicleMessage.model_validate_json(sample.payload)
        vehicle = message.vehicle
        if vehicle is not None and (not self.poses or vehicle.stamp_s > self.poses[-1].stamp_s):
            pose = Pose(
                vehicle.stamp_s,
                np.asarray(vehicle.position_w),
                np.asarray(vehicle.quaternion_wb),
                np.asarray(vehicle.velocity_w),
            )
            self.poses.append(pose)
        elif vehicle is not None and self.poses[-1].stamp_s - vehicle.stamp_s > 1.0:
            self.poses.clear()
        if message.gimbal is not None:
            self.gimbals.append(message.gimbal)
        if message.camera is not None:
            self.cameras.append(message.camera)
        self._news.set()

    def _take_task(self, sample: Sample) -> None:
        self.task = _TASK.validate_json(sample.payload)
        self._news.set()

    def _take_scan(self, sample: Sample) -> None:
        try:
            self._scan = decode_scan(sample.payload, sample.attachment)
        except BadMessage as error:
            self.bad_messages += 1
            log.warning("a scan was not usable: %s", error)
        self._news.set()

    def gimbal_at(self, stamp_s: float) -> GimbalState | None:
        """Return the gimbal's aim at a time, interpolated between reports."""
        after = None
        for state in reversed(self.gimbals):
            if state.stamp_s <= stamp_s:
                return state if after is None else _between(state, after, stamp_s)
            after = state
        return after


def _between(a: GimbalState, b: GimbalState, stamp_s: float) -> GimbalState:
    span_s = b.stamp_s - a.stamp_s
    share = 0.0 if span_s <= 0 else (stamp_s - a.stamp_s) / span_s
    turn = math.remainder(b.yaw_rad - a.yaw_rad, 2 * math.pi)
    pitch = a.pitch_rad + share * (b.pitch_rad - a.pitch_rad)
    return GimbalState(stamp_s, a.yaw_rad + share * turn, pitch, a.in_control)
