"""A worker flown on a bus in memory, recorded as the recorder does, and fed again."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from config.presets import load_turbine
from config.settings import Settings
from config.turbine import Site
from drivers.bus import Key
from drivers.clock import MonotonicClock
from drivers.codecs import decode_scan, encode_scan
from mission.flight.command import SensingMode, SensingTask
from mission.flight.observation import FlightMode, Vehicle
from mission.processes.runtime import Runtime
from mission.processes.tracking_worker import TrackingWorker
from mission.records.recording import Recording
from mission.remote.messages import Intent, TakenMessage, VehicleMessage
from mission.replay.fed_worker import ReplayBus
from mission.replay.perception import replay_perception
from mission.replay.recorded import RecordedMission
from perception.values import Scan

SECOND = 1_000_000_000
SETTINGS = Settings(sites=(Site(name="t1", turbine="v27"),))


def a_vehicle(t_s):
    one = Vehicle(
        stamp_s=t_s,
        position_w=(0.3 * t_s, -0.2 * t_s, 30.0 + t_s),
        velocity_w=(0.3, -0.2, 1.0),
        quaternion_wb=(1.0, 0.0, 0.0, 0.0),
        yaw_rad=0.0,
        mode=FlightMode.OFFBOARD,
        mode_stamp_s=t_s,
        armed=True,
        in_air=True,
        landed=False,
        heartbeat_stamp_s=t_s,
    )
    return VehicleMessage(vehicle=one).model_dump_json().encode()


def a_scan(t_s, sequence):
    """A wall ahead, seen with noise."""
    rng = np.random.default_rng(sequence)
    points = np.column_stack(
        [rng.normal(12, 0.03, 400), rng.uniform(-6, 6, 400), rng.uniform(-4, 6, 400)]
    )
    blank = np.zeros(400, np.uint8)
    return Scan(
        t_s, sequence, points.astype(np.float32), np.zeros(400, np.float32), blank, blank, 0
    )


def flown(path, told=True, late=False):
    """Fly a worker on scans of which it takes every second; returns the recording."""
    bus = ReplayBus(list(Key))
    worker = TrackingWorker(Runtime(SETTINGS, MonotonicClock(), Path()), bus)
    recording = Recording(path, SETTINGS, load_turbine("v27"))
    intent = Intent(kind="start", id="1", site="t1")
    recording.add(Key.INTENT, intent.model_dump_json().encode(), 0)
    task = SensingTask(SensingMode.IDLE, 4)
    for key, payload in ((Key.TASK, TypeAdapter(SensingTask).dump_json(task)),):
        bus.deliver(key, payload)
        recording.add(key, payload, 0)
    for k in range(1, 60):
        t_s = 0.05 * k
        at = round(t_s * SECOND)
        pose = a_vehicle(t_s)
        bus.deliver(Key.VEHICLE, pose)
        messages = [(Key.VEHICLE, pose, None)]
        if k % 2 == 0:
            sent = encode_scan(a_scan(t_s, k))
            messages.append((Key.SCAN, *sent))
            if k % 4 == 0:
                scan = decode_scan(*sent)
                taken = TakenMessage(
                    worker="tracking", what="scan", stamp_s=scan.stamp_s, pose_s=t_s, task_id=4
                )
                if told:
                    messages.append((Key.TAKEN, taken.model_dump_json().encode(), None))
                worker.take_scan(scan)
        messages += [(key, payload, None) for key, payload in bus.published]
        bus.published.clear()
        for key, payload, attachment in reversed(messages) if late else messages:
            recording.add(key, payload, at, attachment=attachment)
    recording.close()
    return path


@pytest.mark.parametrize("late", [False, True])
def test_what_a_worker_said_it_says_again_to_the_last_bit(tmp_path, late):
    path = flown(tmp_path / "r.mcap", late=late)
    replay = replay_perception(RecordedMission(path), workers=("tracking",))
    clearance = replay.kinds[Key.CLEARANCE]
    assert replay.told
    assert (clearance.recorded, clearance.equal, clearance.first) == (14, 14, "")
    assert replay.agrees


def test_a_recording_that_does_not_tell_what_was_taken_up_is_not_held_to_it(tmp_path):
    path = flown(tmp_path / "r.mcap", told=False)
    replay = replay_perception(RecordedMission(path), workers=("tracking",))
    clearance = replay.kinds[Key.CLEARANCE]
    assert not replay.told
    assert replay.agrees
    # All scans were taken up, twice as many as in flight.
    assert clearance.recomputed == 29
    assert clearance.matched == clearance.recorded == 14


def test_another_setting_is_told_by_how_much_it_differs(tmp_path):
    path = flown(tmp_path / "r.mcap")
    lidar = SETTINGS.lidar.model_copy(update={"nose_down_deg": 0.0})
    other = SETTINGS.model_copy(update={"lidar": lidar})
    replay = replay_perception(RecordedMission(path), other, workers=("tracking",))
    clearance = replay.kinds[Key.CLEARANCE]
    assert clearance.equal == 0
    assert clearance.largest > clearance.mean > 0.01
    assert "nearest" in clearance.first
    assert not replay.agrees
