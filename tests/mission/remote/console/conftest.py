"""Vehicles that tell their states and answer requests, without anything that flies."""

import asyncio
import threading
import time

import pytest

from config.links import Bus as BusSettings
from config.settings import Settings
from config.turbine import Site
from drivers.bus import Bus, Key
from drivers.bus_access import ALL_VERBS
from drivers.free_port import free_port
from mission.flight.command import MissionState, Phase, PhotoCommand, Progress
from mission.remote.console.board import Board
from mission.remote.console.server import ConsoleServer
from mission.remote.desk import TOO_MANY, Desk
from mission.remote.history import History
from mission.remote.messages import (
    EventMessage,
    PhotoResultMessage,
    PhotoTakenMessage,
    StateMessage,
)


class FakeVehicle:
    """One vehicle's desk on a bus, and what it publishes."""

    def __init__(self, bus, name, folder):
        self.bus, self.name = bus, name
        self.history = History(view=0.3)
        self.intents = []
        settings = Settings(
            vehicle=name,
            missions_dir=str(folder / name),
            sites=(Site(name="hill-3", turbine="windpact-1.5", tower_north_m=65),),
        )
        desk = Desk(settings, self.history, self._take, self.tell, {})
        self.history.listen(bus)
        bus.subscribe(Key.STATE, self.history.take)
        bus.answer_requests(ALL_VERBS, desk.answer, per_s=20, too_many=TOO_MANY)
        bus.announce()

    def _take(self, intent):
        self.intents.append((time.monotonic(), intent))

    def tell(self, event):
        self.bus.publish(Key.EVENT, event.model_dump_json().encode())

    def photo(self, number, blade, side, metre, kept):
        command = PhotoCommand(number, blade, side, metre, 12.0)
        taken = PhotoTakenMessage(
            command=command,
            url="",
            index=number,
            stamp_s=1.0,
            utc="",
            position_w=(0, 0, 0),
            quaternion_wb=(1, 0, 0, 0),
            gimbal_yaw_rad=0.0,
            gimbal_pitch_rad=0.0,
        )
        self.bus.publish(Key.PHOTO, taken.model_dump_json().encode())
        result = PhotoResultMessage(photo_id=number, kept=kept)
        self.bus.publish(Key.PHOTO_RESULT, result.model_dump_json().encode())

    def state(self, number, **progress):
        fields = {
            "phase": Phase.TRACK,
            "state": MissionState.RUNNING,
            "words": "along B, leading edge",
            "pass_index": 7,
            "pass_count": 12,
            "blade": "B",
            "side": "LE",
            "metre": 17.0,
            "distance_m": 12.04,
            "clearance_m": 10.4,
            "stop_angle_deg": 61.38,
            "sigma_deg": 0.14,
            "photos": 3,
            "coverage": 0.58,
        } | progress
        message = StateMessage(
            vehicle=self.name,
            mission_dir="/missions/one",
            site="hill-3",
            mission_s=100 + number / 10,
            factor=1.0,
            progress=Progress(**fields),
            position_w=(5.0, 40.0, 71.0),
            battery=0.71,
            yaw_rad=1.6,
            ev=-0.67,
            grey=132.0,
        )
        self.bus.publish(Key.STATE, message.model_dump_json().encode())


class FakeFleet:
    """Vehicles that live in a thread with a loop of their own, as daemons do elsewhere."""

    def __init__(self, names, folder):
        self.settings = BusSettings(listen=f"tcp/127.0.0.1:{free_port()}")
        self._names, self._folder = names, folder
        self.vehicles = {}
        self.progress = {}
        self._ready, self._closing = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._run()), daemon=True)
        self._thread.start()
        assert self._ready.wait(20)

    async def _run(self):
        router = Bus.open_router(self.settings, self._names[0])
        buses = [router] + [Bus.open_client(self.settings, name) for name in self._names[1:]]
        for name, bus in zip(self._names, buses, strict=True):
            self.vehicles[name] = FakeVehicle(bus, name, self._folder)
        self._ready.set()
        number = 0
        while not self._closing.is_set():
            number += 1
            for name, vehicle in self.vehicles.items():
                vehicle.state(number, **self.progress.get(name, {}))
            await asyncio.sleep(0.1)
        for bus in reversed(buses):
            bus.close()

    def close(self):
        self._closing.set()
        self._thread.join(20)


@pytest.fixture
def fleet(tmp_path):
    fleets = []

    def open_fleet(*names):
        fleets.append(FakeFleet(names, tmp_path))
        return fleets[-1]

    yield open_fleet
    for one in fleets:
        one.close()


@pytest.fixture
def heron(fleet):
    """A fleet of one vehicle, which has a short history."""
    one = fleet("heron")
    vehicle = one.vehicles["heron"]
    for number, kept in ((0, True), (1, True), (2, False)):
        vehicle.photo(number, "A", "PS", 2.0 + 3 * number, kept)
    vehicle.tell(EventMessage(mission_s=90.0, name="x", severity="warn", text="scans come late"))
    vehicle.tell(EventMessage(mission_s=95.0, name="x", severity="info", text="<b>bold</b>"))
    return one


def wait_until(true, within_s=20.0):
    deadline = time.monotonic() + within_s
    while not true():
        assert time.monotonic() < deadline, "it did not come true in time"
        time.sleep(0.02)


@pytest.fixture
def serve():
    """Open a board and a server on a fleet."""
    opened = []

    def open_console(one):
        board = Board(one.settings)
        board.__enter__()
        opened.append(board)
        server = ConsoleServer(board, 0)
        server.__enter__()
        opened.append(server)
        wait_until(lambda: len(board.live()) == len(one.vehicles))
        return board, server

    yield open_console
    for each in reversed(opened):
        each.__exit__(None, None, None)
