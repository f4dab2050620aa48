"""Cameras as others build them: how they count their photos, and when they say so."""

import asyncio
import contextlib

import pytest

from config.sensors import Camera
from drivers.autopilot_errors import Refused
from drivers.autopilot_wire import Received
from drivers.clock import MonotonicClock
from drivers.payload_camera import Shutter

CAMERA = 100
CAPTURE, REQUEST = 2000, 512


class Wire:
    """A camera on the other end of a wire; ``on_capture`` is what it does when asked."""

    def __init__(self, on_capture=lambda: None):
        self.listeners = {}
        self.on_capture = on_capture
        self.boot_ms = 5000

    def listen(self, name, listener, component_id=None):
        assert component_id == CAMERA
        self.listeners[name] = listener

    def hear(self, name, **fields):
        self.boot_ms += 1000
        told = {"time_boot_ms": self.boot_ms, **fields}
        self.listeners[name](Received(name, CAMERA, told, 10**9))

    def captured(self, index, **fields):
        told = {"image_index": index, "capture_result": 1, "file_url": "", **fields}
        self.hear("CAMERA_IMAGE_CAPTURED", **told)

    async def command(self, _what, command, _parameters, component_id=1, **_):
        assert component_id == CAMERA
        await asyncio.sleep(0)
        if command == CAPTURE:
            self.on_capture()


@contextlib.asynccontextmanager
async def camera(on_capture):
    wire = Wire()
    wire.on_capture = lambda: on_capture(wire)
    taken, failed, ended = [], [], asyncio.Event()

    def end(photo, why=""):
        taken.append(photo) if not why else failed.append((photo, why))
        ended.set()

    shutter = Shutter(wire, Camera(min_interval_s=0.01), MonotonicClock(), end, end)
    running = asyncio.create_task(shutter.run())

    async def take(photo_id):
        ended.clear()
        assert shutter.request(photo_id)
        await asyncio.wait_for(ended.wait(), 1.0)

    try:
        yield wire, take, taken, failed
    finally:
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running


@pytest.fixture(autouse=True)
def _soon(monkeypatch):
    monkeypatch.setattr("drivers.payload_camera._CAPTURED_TIMEOUT_S", 0.05)
    monkeypatch.setattr("drivers.payload_camera._ASK_AGAIN_TIMEOUT_S", 0.02)


async def test_a_camera_that_does_not_count_its_photos_takes_photos():
    async with camera(lambda wire: wire.captured(0)) as (_, take, taken, failed):
        for photo in (7, 8, 9):
            await take(photo)
    assert [photo.photo_id for photo in taken] == [7, 8, 9]
    assert not failed


async def test_a_report_that_comes_once_more_is_not_another_photo():
    def repeat(wire):
        wire.captured(4, time_boot_ms=6000)

    async with camera(repeat) as (_, take, taken, failed):
        await take(7)
        await take(8)
    assert [photo.photo_id for photo in taken] == [7]
    assert [photo for photo, _ in failed] == [8]


async def test_a_camera_that_was_switched_off_meanwhile_counts_anew():
    counted = iter([40, 41, 0, 1])

    def shoot(wire):
        wire.captured(next(counted))

    async with camera(shoot) as (wire, take, taken, failed):
        wire.hear("CAMERA_CAPTURE_STATUS", image_count=40)
        await take(1)
        await take(2)
        wire.hear("CAMERA_CAPTURE_STATUS", image_count=42)
        wire.boot_ms = 0
        wire.hear("CAMERA_CAPTURE_STATUS", image_count=0)
        await take(3)
        await take(4)
    assert [photo.index for photo in taken] == [40, 41, 0, 1]
    assert not failed


async def test_a_report_before_the_acknowledgement_counts():
    async with camera(lambda wire: wire.captured(0, q=None)) as (_, take, taken, _failed):
        await take(1)
    assert taken[0].file_url == ""


async def test_a_camera_that_refuses_says_so():
    def refuse(_wire):
        raise Refused("photo: denied")

    async with camera(refuse) as (_, take, _taken, failed):
        await take(1)
    assert failed == [(1, "photo: denied")]
