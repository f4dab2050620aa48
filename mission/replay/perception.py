"""Estimates and exposure decisions computed anew: the workers themselves, fed from the recording.

The recording tells which scan or frame each worker took up and which poses it knew then
(`perception/taken`); so given, a worker says the same again. What it knew from before the mission
was started is not in the recording: the first seconds may differ. A recording from before this
was told is replayed as if each scan had been taken up as soon as its pose was there.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from config.settings import Settings
from drivers.bus import Key
from mission.processes.sensor_inbox import Worker
from mission.remote.messages import TakenMessage
from mission.replay.estimates import Compared, compare
from mission.replay.fed_worker import OF_WORKER, FedWorker
from mission.replay.recorded import Recorded, RecordedMission

_INPUTS = (Key.SCAN, Key.FRAME, Key.VEHICLE, Key.TASK, Key.TAKEN)
#: Scans and frames that may be waiting to be taken up.
_KEPT = 60
#: Looked this far for a pose or a task that a worker knew and the recording holds later.
LOOK_AHEAD = 300
#: What a worker knew from before the recording may keep so many of its answers from being equal.
LEAST_EQUAL = 0.95
_Seen: TypeAlias = dict[str, deque[tuple[float, Recorded]]]


@dataclass(slots=True)
class PerceptionReplay:
    """All kinds of estimates compared."""

    kinds: dict[str, Compared] = field(default_factory=dict)
    told: bool = True
    """The recording says what each worker took up."""
    flown_s: float = 0.0
    took_s: float = 0.0

    @property
    def agrees(self) -> bool:
        """Whether the estimates came out again, as far as the recording can tell."""
        return not self.told or all(one.share_equal >= LEAST_EQUAL for one in self.kinds.values())

    @property
    def speed(self) -> float:
        """Mission seconds per second of computing."""
        return self.flown_s / self.took_s if self.took_s > 0 else 0.0


def replay_perception(
    recorded: RecordedMission,
    settings: Settings | None = None,
    workers: tuple[Worker, ...] = ("tracking", "estimation"),
) -> PerceptionReplay:
    """Recompute every estimate of a recording and compare. Raises `NotARecording`."""
    begun_s = time.process_time()
    settings = recorded.mission.settings if settings is None else settings
    told = any(True for _ in recorded.messages({Key.TAKEN}))
    fed = {worker: FedWorker(worker, settings) for worker in workers}
    mine: dict[str, list[bytes]] = {key: [] for worker in workers for key in OF_WORKER[worker]}
    first_s = last_s = None
    for message in _fed_in_order(recorded, fed, told=told, beside=mine):
        first_s = message.mission_s if first_s is None else first_s
        last_s = message.mission_s
        if message.key in mine:
            mine[message.key].append(message.payload)
    result = PerceptionReplay(told=told)
    anew = [item for worker in fed.values() for item in worker.bus.published]
    for key, payloads in mine.items():
        result.kinds[key] = compare(key, payloads, [data for name, data in anew if name == key])
    result.flown_s = 0.0 if first_s is None or last_s is None else last_s - first_s
    result.took_s = time.process_time() - begun_s
    return result


def _fed_in_order(
    recorded: RecordedMission,
    fed: dict[Worker, FedWorker],
    *,
    told: bool,
    beside: Collection[str],
) -> Iterator[Recorded]:
    """Feed the workers; yields each message that was read, those of the keys ``beside`` too."""
    seen: _Seen = {key: deque(maxlen=_KEPT) for key in (Key.SCAN, Key.FRAME)}
    pending: deque[TakenMessage] = deque()
    for message in recorded.messages({*_INPUTS, *beside}):
        yield message
        if message.key in (Key.VEHICLE, Key.TASK):
            for one in fed.values():
                one.hear(message)
        elif message.key in seen:
            seen[message.key].append((_stamp_of(message), message))
            if not told:
                for one in fed.values():
                    one.catch_up()
                    if message.key == Key.SCAN or one.worker == "tracking":
                        one.take(message)
        elif message.key == Key.TAKEN:
            pending.append(TakenMessage.model_validate_json(message.payload))
        _work_off(pending, seen, fed)


def _work_off(pending: deque[TakenMessage], seen: _Seen, fed: dict[Worker, FedWorker]) -> None:
    """Carry out in order what the workers took up, as far as the recording has shown it."""
    while pending:
        taken = pending[0]
        one = fed.get(taken.worker)
        if one is not None:
            what = _find(seen[Key.SCAN if taken.what == "scan" else Key.FRAME], taken.stamp_s)
            ready = what is not None and one.know(taken.pose_s, taken.task_id)
            if not ready and len(pending) < LOOK_AHEAD:
                return
            if what is not None:
                one.take(what)
        pending.popleft()


def _find(seen: deque[tuple[float, Recorded]], stamp_s: float) -> Recorded | None:
    return next((message for at_s, message in reversed(seen) if at_s == stamp_s), None)


def _stamp_of(message: Recorded) -> float:
    """Return the time of a scan or frame as its reader has it."""
    kind = PointCloud if message.key == Key.SCAN else CompressedImage
    stamp = kind.FromString(message.payload).timestamp
    return float(stamp.seconds) + float(stamp.nanos) * 1e-9
