"""The recorder fed by hand: photos fetched from a camera that at first does not give them out."""

import asyncio
import http.server
import json
import shutil
import socket
import threading
from collections import Counter

import cv2
import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from config.settings import Settings
from config.turbine import Site
from drivers.autopilot_tap import TAP_FILE
from drivers.bus import Key, Sample
from drivers.clock import MonotonicClock
from mission.flight.command import MissionState, Phase, PhotoCommand
from mission.flight.observation import FlightMode, GimbalState, RequestKind, Vehicle
from mission.flight.report import MissionReport, PhaseTime
from mission.processes.recorder import Recorder
from mission.processes.runtime import Runtime
from mission.records.room import Room
from mission.remote.messages import FlightReport, Intent, PhotoTakenMessage, VehicleMessage
from mission.replay.recorded import RecordedMission


class HandBus:
    """A bus that delivers what the test says, and keeps what is published."""

    def __init__(self):
        self.said = []

    def subscribe(self, _keys, take):
        self.take = take

    def publish(self, key, payload, **_):
        self.said.append((key, json.loads(payload)))

    def deliver(self, key, message):
        payload = message if isinstance(message, bytes) else message.model_dump_json().encode()
        self.take(Sample(key, payload, None))


class Camera:
    """Photos over HTTP; ``missing`` are not given out."""

    def __init__(self):
        self.missing = set()
        camera = self
        picture = np.random.default_rng(1).normal(130, 6, (120, 160)).astype(np.uint8)
        jpeg = cv2.imencode(".jpg", picture)[1].tobytes()

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                found = self.path not in camera.missing
                self.send_response(200 if found else 404)
                self.end_headers()
                if found:
                    # Each photo is another picture.
                    self.wfile.write(jpeg[:-2] + self.path.encode() + jpeg[-2:])

            def log_request(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_address[1]}"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()


@pytest.fixture
def camera():
    camera = Camera()
    yield camera
    camera.server.shutdown()
    camera.server.server_close()


def taken(photo_id, camera):
    return PhotoTakenMessage(
        command=PhotoCommand(photo_id, "A", "PS", 4.0 * photo_id, 12.0),
        url=f"{camera.url}/{photo_id}", index=photo_id, stamp_s=10.0 + photo_id,
        utc=f"2026-03-01T10:20:{photo_id:02d}.500Z", position_w=(0.0, 0.0, 50.0),
        quaternion_wb=(1.0, 0.0, 0.0, 0.0), gimbal_yaw_rad=0.0, gimbal_pitch_rad=0.0,
        distance_m=12.0,
    )  # fmt: skip


def vehicle(at_s):
    return VehicleMessage(
        vehicle=Vehicle(
            at_s, (1.0, 2.0, 50.0), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 0.0,
            FlightMode.OFFBOARD, at_s, True, True, False, at_s,
        ),
        gimbal=GimbalState(at_s, 0.2, 0.1),
    )  # fmt: skip


def the_end():
    report = MissionReport(
        state=MissionState.COMPLETED, words="landed", started_s=0.0, duration_s=60.0,
        phases=(PhaseTime(Phase.IDLE, 0.0, 60.0),), rotor=None, iterations=0, passes=(), events=(),
    )  # fmt: skip
    return FlightReport(
        report=report, site="hill-3", turbine="windpact-1.5", operator="A", rotor_locked=True,
        started_utc="2026-03-01T10:14:00+00:00", tower_foot_w=(0.0, 0.0, 0.0),
    )  # fmt: skip


async def until(condition):
    # What is waited for happens in threads and over HTTP: there is nothing to be awaited.
    async with asyncio.timeout(20.0):
        while not condition():  # noqa: ASYNC110 - as said above
            await asyncio.sleep(0.01)


async def record(tmp_path, camera, monkeypatch):
    """Fly three photos; the second is missing at first, the third for good."""
    monkeypatch.setattr("mission.records.photos.FETCH_WAIT_S", 0.0)
    site = Site(name="hill-3", turbine="windpact-1.5", blade_serials={"A": "SN-1"})
    runtime = Runtime(Settings(sites=(site,)), MonotonicClock(), tmp_path)
    bus = HandBus()
    running = asyncio.create_task(Recorder(runtime, bus).run())
    await asyncio.sleep(0)
    folder = tmp_path / "mission"
    folder.mkdir()
    start = Intent(kind=RequestKind.START, id="1", site="hill-3", mission_dir=str(folder))
    bus.deliver(Key.INTENT, start)
    bus.deliver(Key.VEHICLE, vehicle(10.9))
    bus.deliver(Key.VEHICLE, vehicle(11.1))
    bus.deliver(Key.BLADE, b'{"broken": true}')
    camera.missing = {"/2", "/3"}
    for photo_id in (1, 2, 3):
        bus.deliver(Key.PHOTO, taken(photo_id, camera))
    await until(lambda: len([s for s in bus.said if s[0] == Key.PHOTO_RESULT]) == 3)
    camera.missing = {"/3"}
    bus.deliver(Key.REPORT, the_end())
    await until(lambda: any(key == Key.RECORDED for key, _ in bus.said))
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    return folder, bus.said


def test_photos_are_stored_and_missing_ones_are_asked_for_again(tmp_path, camera, monkeypatch):
    folder, said = asyncio.run(record(tmp_path, camera, monkeypatch))
    told = {}
    for key, message in said:
        if key == Key.PHOTO_RESULT:
            told.setdefault(message["photo_id"], []).append(message["kept"])
    assert told == {1: [True], 2: [False, True], 3: [False, False]}
    (recorded,) = [message for key, message in said if key == Key.RECORDED]
    assert recorded["ok"], recorded["text"]
    mission = json.loads((folder / "mission.json").read_text())
    assert mission["photos"] == {"kept": 2, "rejected": 0, "lost": 1}
    assert "photo 3" in mission["lost"][0]
    sidecars = [json.loads(path.read_text()) for path in folder.glob("photos/A/PS/*.json")]
    first = next(one for one in sidecars if one["photo_id"] == 1)
    # Between two reports of the vehicle, not where the message says; and which blade it is.
    assert first["position_w"] == pytest.approx([1.1, 2.0, 50.0], abs=0.11)
    assert first["serial"] == "SN-1"


async def come_back(tmp_path, camera):
    """Record one photo, be killed; another recorder is told of the mission and sees its end."""
    site = Site(name="hill-3", turbine="windpact-1.5")
    runtime = Runtime(Settings(sites=(site,)), MonotonicClock(), tmp_path)
    folder = tmp_path / "mission"
    folder.mkdir()
    start = Intent(kind=RequestKind.START, id="1", site="hill-3", mission_dir=str(folder))
    said = []
    for key, photo_id in ((Key.INTENT, 1), (Key.RECORD, 2)):
        bus = HandBus()
        running = asyncio.create_task(Recorder(runtime, bus).run())
        await asyncio.sleep(0)
        bus.deliver(key, start)
        bus.deliver(key, start)
        bus.deliver(Key.VEHICLE, vehicle(10.9))
        bus.deliver(Key.PHOTO, taken(photo_id, camera))
        await until(lambda bus=bus: any(k == Key.PHOTO_RESULT for k, _ in bus.said))
        if key == Key.RECORD:
            bus.deliver(Key.REPORT, the_end())
            await until(lambda bus=bus: any(k == Key.RECORDED for k, _ in bus.said))
        said += bus.said
        running.cancel()
        with pytest.raises(asyncio.CancelledError):
            await running
    return folder, said


def test_a_recorder_that_comes_back_goes_on_with_the_mission_and_loses_no_photo(tmp_path, camera):
    folder, said = asyncio.run(come_back(tmp_path, camera))
    assert json.loads((folder / "mission.json").read_text())["photos"]["kept"] == 2
    assert sorted(path.name for path in folder.glob("*.mcap")) == [
        "recording-2.mcap",
        "recording.mcap",
    ]
    ready = [message for key, message in said if key == Key.READY]
    assert ready[0]["name"] == "recorder"
    assert ready[0]["recording"] == ""


async def hear_the_link(tmp_path):
    """Play flight's end of the tap, and end the recorder in the middle of the mission."""
    loop = asyncio.get_running_loop()
    runtime = Runtime(Settings(), MonotonicClock(), tmp_path)
    packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    frame = bytes(packer.heartbeat_encode(2, 12, 81, 0, 4).pack(packer))
    bus = HandBus()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as flight:
        flight.bind(("127.0.0.1", 0))
        flight.setblocking(False)
        (tmp_path / TAP_FILE).write_text(f"{flight.getsockname()[1]}\n")
        running = asyncio.create_task(Recorder(runtime, bus).run())
        with pytest.raises(TimeoutError):  # before the mission nobody listens
            await asyncio.wait_for(loop.sock_recvfrom(flight, 1024), 0.1)
        start = Intent(kind=RequestKind.START, id="1", site="one", mission_dir=str(tmp_path))
        bus.deliver(Key.INTENT, start)
        beat, listener = await asyncio.wait_for(loop.sock_recvfrom(flight, 1024), 10.0)
        for _ in range(3):
            await loop.sock_sendto(flight, frame, listener)
        await asyncio.sleep(0.1)
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    return beat, frame


def test_the_vehicles_link_is_recorded_beside_the_bus(tmp_path):
    beat, frame = asyncio.run(hear_the_link(tmp_path))
    (message,) = mavlink.MAVLink(None).parse_buffer(beat)
    assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 155)
    data = (tmp_path / "link.tlog").read_bytes()
    assert [data[at : at + len(frame)] for at in range(8, len(data), 8 + len(frame))] == [frame] * 3


async def fill_the_disk(tmp_path, monkeypatch):
    """End a mission of which the disk had less and less room, and at last none for the events."""
    runtime = Runtime(Settings(), MonotonicClock(), tmp_path)
    monkeypatch.setattr("mission.processes.recorder.READY_S", 0.01)
    free = [1 << 40]
    usage = shutil.disk_usage("/")._replace
    monkeypatch.setattr("mission.records.room.shutil.disk_usage", lambda _: usage(free=free[-1]))
    folder = tmp_path / "mission"
    folder.mkdir()
    bus = HandBus()
    recorder = Recorder(runtime, bus)
    running = asyncio.create_task(recorder.run())
    await asyncio.sleep(0)
    start = Intent(kind=RequestKind.START, id="1", site="one", mission_dir=str(folder))
    bus.deliver(Key.INTENT, start)
    for free_now, room in (
        (1 << 40, Room.EVERYTHING), (400 << 20, Room.RECORDING), (1 << 20, Room.PHOTOS),
    ):  # fmt: skip
        free.append(free_now)
        await until(lambda room=room: recorder._open.space.room is room)
        for key in (Key.FRAME, Key.STATE):
            bus.deliver(key, b"{}")
    (folder / "events.jsonl").mkdir()
    bus.deliver(Key.EVENT, b'{"mission_s": 1, "name": "x", "severity": "none", "text": ""}')
    await until(lambda: recorder._open.event_lines_lost == 1)
    (folder / "events.jsonl").rmdir()
    bus.deliver(Key.REPORT, the_end())
    await until(lambda: any(key == Key.RECORDED for key, _ in bus.said))
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    return folder


def test_what_finds_no_room_is_left_out_in_order_and_named_in_the_report(tmp_path, monkeypatch):
    folder = asyncio.run(fill_the_disk(tmp_path, monkeypatch))
    monkeypatch.undo()
    counts = Counter(message.key for message in RecordedMission(folder).messages())
    assert (counts[Key.FRAME], counts[Key.STATE]) == (1, 2)
    mission = json.loads((folder / "mission.json").read_text())
    assert mission["photos"]["lost"] == 0
    page = (folder / "report.html").read_text()
    for words in (
        "the live picture is not in the recording",
        "the recording ends from mission second",
        "events.jsonl lacks 1 lines: Is a directory",
    ):
        assert any(words in line for line in mission["lost"])
        assert words in page
