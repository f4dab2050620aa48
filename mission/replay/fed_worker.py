"""A perception worker as it flies, fed from a recording instead of the bus."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Collection
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from config.settings import Settings
from drivers.bus import Bus, Key, Sample
from drivers.codecs import BadMessage, decode_scan
from mission.flight.command import SensingTask
from mission.processes.estimation_worker import EstimationWorker
from mission.processes.runtime import Runtime
from mission.processes.sensor_inbox import Worker
from mission.processes.tracking_worker import TrackingWorker
from mission.remote.messages import VehicleMessage
from mission.replay.recorded import Recorded
from perception.values import Scan

#: What each worker publishes that a recording is compared by.
OF_WORKER: dict[Worker, tuple[str, ...]] = {
    "tracking": (Key.CLEARANCE, Key.BLADE, Key.EXPOSURE),
    "estimation": (Key.HUB_PRIOR, Key.ROTOR),
}

_SEQUENCE = struct.Struct("<QI")
_TASK = TypeAdapter(SensingTask)


class ReplayBus(Bus):
    """A bus within one process: keeps what is published, hands over what it is given."""

    def __init__(self, kept: Collection[str]) -> None:
        # Not the session of a real bus: no thread, no network.
        self.dropped = 0
        self._kept = kept
        self.published: list[tuple[str, bytes]] = []
        self._takers: dict[str, list[Callable[[Sample], None]]] = {}

    def publish(
        self,
        key: str,
        payload: bytes,
        *,
        encoding: str = "application/json",  # noqa: ARG002 - as the bus is called
        attachment: bytes | None = None,  # noqa: ARG002
        droppable: bool = False,  # noqa: ARG002
    ) -> None:
        """Keep an estimate; what else a worker says is of no interest here."""
        if key in self._kept:
            self.published.append((key, payload))

    def subscribe(self, key: str, callback: Callable[[Sample], None]) -> None:
        """Remember who takes a key."""
        self._takers.setdefault(key, []).append(callback)

    def subscribe_newest(self, key: str, callback: Callable[[Sample], None]) -> None:
        """Remember who takes a key."""
        self.subscribe(key, callback)

    def deliver(self, key: str, payload: bytes, attachment: bytes | None = None) -> None:
        """Hand a message over, at once."""
        for take in self._takers.get(key, ()):
            take(Sample(key, payload, attachment))


class _StillClock:
    """The workers compute from stamps alone; no time passes while they are fed."""

    def now_s(self) -> float:
        """Return the beginning."""
        return 0.0

    def factor(self) -> float:
        """Return 1."""
        return 1.0

    def mission_time_of(self, monotonic_ns: int) -> float:
        """Return the moment itself."""
        return monotonic_ns * 1e-9


class FedWorker:
    """One worker with its bus and what was read for it but not yet handed over."""

    def __init__(self, worker: Worker, settings: Settings) -> None:
        self.worker = worker
        self.bus = ReplayBus(OF_WORKER[worker])
        runtime = Runtime(settings, _StillClock(), Path())
        self._take_scan = (
            TrackingWorker(runtime, self.bus).take_scan
            if worker == "tracking"
            else EstimationWorker(runtime, self.bus).take_scan
        )
        self._pose_s = float("-inf")
        self._task_id: int | None = None
        self._waiting: deque[Recorded] = deque()
        """Vehicle states and tasks in order, not yet handed over."""

    def hear(self, message: Recorded) -> None:
        """Queue a vehicle state or a task."""
        self._waiting.append(message)

    def know(self, pose_s: float | None, task_id: int) -> bool:
        """Hand over what the worker knew; False: the recording has not shown it yet."""
        while not self._knows(pose_s, task_id):
            if not self._waiting:
                return False
            self._hand_over(self._waiting.popleft())
        return True

    def catch_up(self) -> float:
        """Hand over all that was heard; return the stamp of the newest pose."""
        while self._waiting:
            self._hand_over(self._waiting.popleft())
        return self._pose_s

    def _knows(self, pose_s: float | None, task_id: int) -> bool:
        posed = pose_s is None or self._pose_s >= pose_s
        # Task 0 is what a worker begins with, before it has heard of any.
        return posed and (self._task_id == task_id or (self._task_id is None and task_id == 0))

    def _hand_over(self, message: Recorded) -> None:
        try:
            if message.key == Key.TASK:
                self._task_id = _TASK.validate_json(message.payload).task_id
            else:
                vehicle = VehicleMessage.model_validate_json(message.payload).vehicle
                if vehicle is not None:
                    self._pose_s = vehicle.stamp_s
        except ValidationError:
            return
        self.bus.deliver(message.key, message.payload)

    def take(self, what: Recorded) -> None:
        """Have the worker take up a scan or a frame."""
        attachment = _SEQUENCE.pack(what.sequence, 0)
        if what.key == Key.FRAME:
            self.bus.deliver(Key.FRAME, what.payload, attachment)
            return
        try:
            scan = decode_scan(what.payload, attachment)
        except BadMessage:
            return
        self.take_scan(scan)

    def take_scan(self, scan: Scan) -> None:
        """Have the worker take up a scan."""
        self._take_scan(scan)
