import errno
import json
import math
import os
import random
import re
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from pydantic import TypeAdapter

from benchmarks.virtual_turbine import Truth, true_model
from config.presets import load_turbine
from config.settings import Settings
from drivers.bus import Key
from drivers.codecs import encode_frame, encode_points, encode_scan
from mission.flight.command import (
    Command,
    MissionState,
    Phase,
    PhotoCommand,
    Progress,
    SensingMode,
    SensingTask,
)
from mission.flight.observation import (
    BladeEstimate,
    BladeTrack,
    FlightMode,
    GimbalState,
    Observation,
    RotorEstimate,
    Vehicle,
)
from mission.flight.plan import plan
from mission.records.recording import (
    JSON_CHANNELS,
    METADATA,
    SENSOR_CHANNELS,
    Recording,
    _json_schema,
)
from mission.records.scene import VIEW_CHANNELS
from mission.remote.messages import (
    EventMessage,
    PhotoResultMessage,
    PhotoTakenMessage,
    TickRecord,
    VehicleMessage,
)
from mission.remote.plan_message import LegMessage, PlanMessage, told
from mission.replay.recorded import RecordedMission
from perception.deskew import points_in_world
from perception.geometry import rotation_from_quaternion
from perception.values import Frame, Pose, Scan

ROOT = Path(__file__).parents[3]
SECOND = 1_000_000_000
QUATERNION = (0.9886634078669658, -0.015231070920259906, -0.02642475890294812, -0.14701840714333803)


def a_vehicle(t_s=1.0):
    vehicle = Vehicle(
        stamp_s=t_s,
        position_w=(3.0, -4.0, 50.0),
        velocity_w=(0.0, 0.0, 0.0),
        quaternion_wb=QUATERNION,
        yaw_rad=0.3,
        mode=FlightMode.OFFBOARD,
        mode_stamp_s=t_s,
        armed=True,
        in_air=True,
        landed=False,
        heartbeat_stamp_s=t_s,
        latitude_deg=54.0,
        longitude_deg=6.5,
        altitude_m=70.0,
    )
    gimbal = GimbalState(t_s, 1.2, -0.1)
    return VehicleMessage(vehicle=vehicle, gimbal=gimbal).model_dump_json().encode()


def a_scan(t_s=1.0, points=1200, sequence=7):
    rng = np.random.default_rng(3)
    return Scan(
        stamp_s=t_s,
        sequence=sequence,
        points_l=rng.uniform(2, 40, (points, 3)).astype(np.float32),
        age_s=np.zeros(points, np.float32),
        reflectivity=np.zeros(points, np.uint8),
        tag=np.zeros(points, np.uint8),
        lost_packets=0,
    )


def a_frame(t_s=1.0):
    grey = np.random.default_rng(4).integers(100, 140, (480, 640), np.uint8)
    return Frame(t_s, 5, grey)


def a_track():
    track = BladeTrack(1.0, "A", (1, 2, 3), (0, 0, 1), 12.0, 500.0, (0, 0, 0), 0.1)
    return TypeAdapter(BladeTrack).dump_json(track)


@pytest.fixture
def recorded(tmp_path):
    """A recording of a bit of everything."""
    path = tmp_path / "recording.mcap"
    recording = Recording(path, Settings(), load_turbine("v27"))
    scan, attachment = encode_scan(a_scan())
    recording.add(Key.SCAN, scan, SECOND, attachment=attachment, utc_ns=5 * SECOND)
    recording.add(Key.FRAME, encode_frame(a_frame())[0], SECOND)
    recording.add(Key.VEHICLE, a_vehicle(), 2 * SECOND)
    recording.add(Key.BLADE, a_track(), 2 * SECOND)
    recording.add(Key.OCCUPANCY, encode_points(np.zeros((5, 3), np.float32), 1.0), 2 * SECOND)
    event = EventMessage(mission_s=2.0, name="phase", severity="warn", text="late")
    recording.add(Key.EVENT, event.model_dump_json().encode(), 2 * SECOND)
    recording.close()
    return path


def read(path):
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [
            (channel.topic, schema, message)
            for schema, channel, message in reader.iter_messages(log_time_order=False)
        ]


def decoded(path, topic):
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [found.decoded_message for found in reader.iter_decoded_messages(topics=[topic])]


def test_the_stock_reader_reads_what_was_written(recorded):
    schemas = {topic: schema.name for topic, schema, _ in read(recorded)}
    assert schemas["/sensor/lidar/scan"] == "foxglove.PointCloud"
    assert schemas["/sensor/camera/frame"] == "foxglove.CompressedImage"
    assert schemas["/view/transforms"] == "foxglove.FrameTransforms"
    assert schemas["/view/scene"] == "foxglove.SceneUpdate"
    assert schemas["/vehicle/state"] == "bladescout.vehicle.state"
    assert {topic.removeprefix("/") for topic in schemas} >= set(VIEW_CHANNELS)


def test_a_cloud_is_recorded_byte_for_byte_with_the_sensors_own_count(recorded):
    scan, _ = encode_scan(a_scan())
    (message,) = (m for topic, _, m in read(recorded) if topic == "/sensor/lidar/scan")
    assert message.data == scan
    assert message.sequence == 7
    assert (message.log_time, message.publish_time) == (SECOND, 5 * SECOND)


def test_settings_turbine_and_code_are_in_the_file(recorded):
    with recorded.open("rb") as file:
        (described,) = (m.metadata for m in make_reader(file).iter_metadata() if m.name == METADATA)
    assert Settings.model_validate_json(described["settings"]) == Settings()
    assert load_turbine("v27").model_validate_json(described["turbine"]) == load_turbine("v27")
    assert re.fullmatch(r"[0-9a-f]{16}", described["code"])


def test_the_transforms_put_a_cloud_where_the_method_puts_it(recorded):
    (transforms,) = decoded(recorded, "/view/transforms")
    by_child = {one.child_frame_id: one for one in transforms.transforms}
    chain = np.eye(4)
    for child in ("body", "lidar"):
        one, step = by_child[child], np.eye(4)
        step[:3, :3] = rotation_from_quaternion(
            (one.rotation.w, one.rotation.x, one.rotation.y, one.rotation.z)
        )
        step[:3, 3] = one.translation.x, one.translation.y, one.translation.z
        chain = chain @ step
    scan = a_scan(points=20)
    pose = Pose(1.0, np.array([3.0, -4.0, 50.0]), np.array(QUATERNION), np.zeros(3))
    world, _ = points_in_world(scan, [pose], Settings().lidar)
    assert scan.points_l @ chain[:3, :3].T + chain[:3, 3] == pytest.approx(world, abs=1e-4)


def test_the_camera_frame_looks_where_the_gimbal_does(recorded):
    (transforms,) = decoded(recorded, "/view/transforms")
    (camera,) = (t for t in transforms.transforms if t.child_frame_id == "camera")
    turn = (camera.rotation.w, camera.rotation.x, camera.rotation.y, camera.rotation.z)
    axis = rotation_from_quaternion(turn)[:, 2]
    level = np.cos(-0.1)
    assert axis == pytest.approx([level * np.cos(1.2), level * np.sin(1.2), np.sin(-0.1)])
    (calibration,) = decoded(recorded, "/view/calibration")
    assert (calibration.width, calibration.height) == (640, 480)
    assert calibration.K[0] == pytest.approx(20.0 / 7.6 * 640)


def test_a_photo_on_the_scene_takes_the_colour_of_its_verdict(tmp_path):
    recording = Recording(tmp_path / "r.mcap", Settings())
    result = PhotoResultMessage(photo_id=3, kept=True)
    recording.add(Key.PHOTO_RESULT, result.model_dump_json().encode(), SECOND)
    recording.add(Key.BLADE, b'{"broken', SECOND)
    recording.close()
    # Of a photo that was never told there is no place; what is broken is recorded as it came.
    assert [topic for topic, _, _ in read(tmp_path / "r.mcap")] == [
        "/mission/photo_result",
        "/perception/blade",
    ]


def test_the_scene_shows_the_plan_and_what_of_the_blade_is_covered(tmp_path):
    recording = Recording(tmp_path / "r.mcap", Settings())
    legs = (
        LegMessage(blade="A", side="PS", line_w=((0, 0, 5), (0, 0, 9)), photos_m=(1.0, 5.0)),
        LegMessage(blade="A", side="SS", line_w=((3, 0, 9), (3, 0, 5)), photos_m=(5.0, 1.0)),
    )
    recording.add(Key.PLAN, PlanMessage(legs=legs).model_dump_json().encode(), SECOND)
    rotor = RotorEstimate(1.0, 1, blades=(BladeEstimate("A", (0.0, 0.0, 1.0), 0.0, 20.0),))
    recording.add(Key.ROTOR, TypeAdapter(RotorEstimate).dump_json(rotor), SECOND)
    taken = PhotoTakenMessage(
        command=PhotoCommand(1, "A", "PS", 3.0, 10.0), url="", index=1, stamp_s=1.0, utc="",
        position_w=(10.0, 0.0, 8.0), quaternion_wb=QUATERNION, gimbal_yaw_rad=0.0,
        gimbal_pitch_rad=0.0, foot_w=(0.0, 0.0, 8.0), distance_m=10.0,
    )  # fmt: skip
    recording.add(Key.PHOTO, taken.model_dump_json().encode(), SECOND)
    result = PhotoResultMessage(photo_id=1, kept=True)
    recording.add(Key.PHOTO_RESULT, result.model_dump_json().encode(), SECOND)
    recording.close()
    entities = [
        e for update in decoded(tmp_path / "r.mcap", "/view/scene") for e in update.entities
    ]
    (lines,) = (one.lines for one in entities if one.id == "plan")
    assert [len(line.points) for line in lines] == [2, 2]
    _, kept = (one for one in entities if one.id == "photo 1")
    (stretch,) = kept.lines
    # 5.7 mm of sensor behind 20 mm of lens see 2.85 m at 10 m, drawn 2 m off the blade.
    ends = [(p.x, p.y, p.z) for p in stretch.points]
    assert np.array(ends) == pytest.approx(np.array([(2, 0, 6.575), (2, 0, 9.425)]))
    assert stretch.color.g > stretch.color.r


def test_a_plan_is_told_as_it_is_flown():
    turbine = load_turbine("v27")
    model = true_model(Truth(), turbine)
    made = plan(model, turbine, Settings(), [("A", "PS")], model.hub_w - 20 * model.normal_w, 0.0)
    message = told(made)
    assert [(one.blade, one.side) for one in message.legs] == [("A", "PS")] * len(made.legs)
    for one, leg in zip(message.legs, made.legs, strict=True):
        assert one.line_w[0] == pytest.approx(leg.position(leg.photos[0]))
        assert one.line_w[-1] == pytest.approx(leg.position(leg.photos[-1]))
        assert one.photos_m == leg.photos


def no_json(word):
    raise AssertionError(f"{word} is no JSON")


def test_viewers_can_parse_every_schema_and_what_is_infinite(tmp_path):
    for key in JSON_CHANNELS:
        json.dumps(_json_schema(key), allow_nan=False)
    silent = VehicleMessage.model_validate_json(a_vehicle())
    assert silent.vehicle.battery_stamp_s == -math.inf
    tick = TickRecord(
        observation=Observation(now_s=1.0, tick=1, vehicle=silent.vehicle),
        command=Command(
            1,
            None,
            None,
            None,
            None,
            None,
            SensingTask(SensingMode.IDLE, 0),
            Progress(Phase.IDLE, MissionState.IDLE, ""),
        ),
        surroundings_s=-math.inf,
    )
    for message in (silent, tick):
        text = message.model_dump_json()
        json.loads(text, parse_constant=no_json)
        assert type(message).model_validate_json(text) == message
        # As it was written before.
        older = text.replace('"-Infinity"', "-Infinity")
        assert type(message).model_validate_json(older) == message


def test_every_channel_and_schema_is_listed_in_the_architecture():
    text = (ROOT / "ARCHITECTURE.md").read_text()
    for key in (*SENSOR_CHANNELS, *JSON_CHANNELS, *VIEW_CHANNELS):
        assert f"`{key}`" in text, key
    for key, kind in (*SENSOR_CHANNELS.items(), *VIEW_CHANNELS.items()):
        row = next(line for line in text.splitlines() if line.startswith(f"| `{key}`"))
        assert f"`{kind.DESCRIPTOR.full_name}`" in text, key
        assert re.search(r"\d+ Hz|on change|as they happen", row), key


WRITER = """
import sys, time
from pathlib import Path
from mission.records.recording import Recording
recording = Recording(Path(sys.argv[1]))
begun = time.monotonic()
print("go", flush=True)
while True:
    now = time.monotonic_ns()
    recording.add("mission/state", b'{"at": %d}' % now, now)
    time.sleep(0.01)
"""


def test_a_killed_recorder_loses_at_most_the_last_second(tmp_path):
    rng = random.Random(5)
    writers = []
    for index in range(2):
        path = tmp_path / f"{index}.mcap"
        command = [sys.executable, "-c", WRITER, str(path)]
        writers.append((path, subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE)))
    for _, writer in writers:
        assert writer.stdout.readline() == b"go\n"
    for path, writer in writers:
        time.sleep(rng.uniform(0.7, 1.2))
        killed_s = time.monotonic()
        writer.send_signal(signal.SIGKILL)
        writer.wait()
        writer.stdout.close()
        mission = RecordedMission(path)
        stamps = [int(m.payload[7:-1]) * 1e-9 for m in mission.messages()]
        assert stamps == sorted(stamps)
        assert mission.cut_short
        assert killed_s - stamps[-1] < 1.0


@pytest.mark.parametrize("after", [0, 3])
def test_a_disk_that_fails_ends_the_recording_and_is_named(tmp_path, monkeypatch, after):
    monkeypatch.setattr("mission.records.recording.CHUNK_S", 0.0)
    monkeypatch.setattr("mission.records.spool.MAX_WAITING_BYTES", 4096)
    really, calls = os.write, []

    def write(file, data):
        calls.append(len(data))
        if len(calls) > after:
            raise OSError(errno.ENOSPC, "No space left on device")
        return really(file, data)

    path = tmp_path / "r.mcap"
    recording = Recording(path)
    monkeypatch.setattr("mission.records.spool.os.write", write)
    noise = np.random.default_rng(1)
    for second in range(40):
        recording.add(Key.STATE, noise.bytes(300), second * SECOND)
    recording.close()
    (words,) = recording.lost()
    assert "No space left on device" in words
    assert re.search(r"mission second \d+", words)
    monkeypatch.undo()
    if after:
        assert len(list(RecordedMission(path).messages())) == after


def test_a_disk_that_recovers_loses_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr("mission.records.recording.CHUNK_S", 0.0)
    really, broken = os.write, [True]

    def write(file, data):
        if broken[0]:
            # A part of it is taken, then no more.
            broken[0] = len(data) < 200
            return really(file, data[:50]) if not broken[0] else really(file, data)
        raise OSError(errno.EIO, "Input/output error")

    recording = Recording(tmp_path / "r.mcap")
    monkeypatch.setattr("mission.records.spool.os.write", write)
    for second in range(5):
        recording.add(Key.STATE, os.urandom(300), second * SECOND)
    monkeypatch.undo()
    for second in range(5, 20):
        recording.add(Key.STATE, b"{}", second * SECOND)
    recording.close()
    assert recording.lost() == ()
    assert [m.log_time for _, _, m in read(tmp_path / "r.mcap")] == [k * SECOND for k in range(20)]


def test_recording_at_full_rate_costs_less_than_a_tenth_of_a_core(tmp_path):
    scan, attachment = encode_scan(a_scan(points=20_000))
    frame, _ = encode_frame(a_frame())
    vehicle, track = a_vehicle(), a_track()
    occupancy = encode_points(np.random.default_rng(2).uniform(0, 30, (1500, 3)), 1.0)
    tick = b'{"observation": "' + b"0.123456789 " * 330 + b'"}'
    recording = Recording(tmp_path / "r.mcap", Settings())
    begun_s, seconds = time.process_time(), 5
    for k in range(20 * seconds):
        at = k * SECOND // 20
        recording.add(Key.VEHICLE, vehicle, at)
        recording.add(Key.COMMAND, tick, at)
        if k % 2:
            recording.add(Key.SCAN, scan, at, attachment=attachment)
            recording.add(Key.FRAME, frame, at)
            recording.add(Key.OCCUPANCY, occupancy, at)
            recording.add(Key.BLADE, track, at)
    recording.close()
    assert time.process_time() - begun_s < 0.1 * seconds


def test_a_point_cloud_without_points_is_one(tmp_path):
    recording = Recording(tmp_path / "r.mcap")
    recording.add(Key.SCAN, encode_scan(a_scan(points=0))[0], 0, attachment=struct.pack("<Q", 1))
    recording.close()
    ((_, _, message),) = read(tmp_path / "r.mcap")
    assert PointCloud.FromString(message.data).data == b""


def test_the_shipped_layout_shows_channels_and_fields_that_exist():
    text = (ROOT / "docs/foxglove-layout.json").read_text()
    json.loads(text)
    channels = {*SENSOR_CHANNELS, *JSON_CHANNELS, *VIEW_CHANNELS}
    shown = re.findall(r'"/([a-z_/]+)(?:\.([a-z_.]+))?"', text)
    assert len(shown) > 10
    for channel, fields in shown:
        assert channel in channels
        node = whole = _json_schema(channel) if fields else {}
        for field in fields.split(".") if fields else ():
            name = node.get("$ref", "").removeprefix("#/$defs/")
            node = (whole["$defs"][name] if name else node)["properties"][field]
