"""A farm of twelve turbines and five vehicles that only pretend to fly."""

import asyncio
import threading
import time
from collections import Counter

import pytest

from config.links import Bus as BusSettings
from config.settings import Settings
from config.turbine import Site
from drivers.bus import Bus, Key
from drivers.bus_access import ALL_VERBS
from drivers.free_port import free_port
from mission.flight.command import MissionState, Phase, Progress
from mission.remote import farm_run
from mission.remote.desk import TOO_MANY, Desk
from mission.remote.farm import Farm, Stage
from mission.remote.farm_run import FarmRun
from mission.remote.fleet import Fleet
from mission.remote.history import History
from mission.remote.messages import StateMessage

TURBINES = tuple(f"t{number}" for number in range(12))
VEHICLES = ("heron", "stork", "crane", "egret", "ibis")
FLIGHT_S = 0.6


class Pretender:
    """Takes a mission, is running for a while, and has completed it."""

    def __init__(self, bus, name, folder):
        self.bus, self.name = bus, name
        self.flown, self.folder, self.until_s = [], "", 0.0
        self.history = History()
        settings = Settings(
            vehicle=name,
            missions_dir=str(folder / name),
            sites=tuple(Site(name=site, turbine="v27") for site in TURBINES),
        )
        self.desk = Desk(settings, self.history, self._take, lambda _: None, {})
        bus.answer_requests(ALL_VERBS, self.desk.answer, per_s=20, too_many=TOO_MANY)

    def _take(self, intent):
        self.flown.append(intent.site)
        self.folder, self.until_s = intent.mission_dir, time.monotonic() + FLIGHT_S

    def step(self):
        running = time.monotonic() < self.until_s
        ended = MissionState.COMPLETED if self.folder else MissionState.IDLE
        state = StateMessage(
            vehicle=self.name,
            mission_dir=self.folder,
            site="",
            mission_s=1.0,
            factor=1.0,
            progress=Progress(Phase.TRACK, MissionState.RUNNING if running else ended, "words"),
            battery=1.0,
        )
        self.history.state = state
        self.desk.take_state(state)
        self.bus.publish(Key.STATE, state.model_dump_json().encode())


@pytest.fixture
def pretenders(tmp_path):
    end = f"tcp/127.0.0.1:{free_port()}"
    ready, closing, all_of_them = threading.Event(), threading.Event(), []

    async def live():
        settings = BusSettings(listen=end)
        router = Bus.open_router(settings, VEHICLES[0])
        buses = [router] + [Bus.open_client(settings, name) for name in VEHICLES[1:]]
        for name, bus in zip(VEHICLES, buses, strict=True):
            all_of_them.append(Pretender(bus, name, tmp_path))
        ready.set()
        while not closing.is_set():
            for one in all_of_them:
                one.step()
            await asyncio.sleep(0.05)
        for bus in reversed(buses):
            bus.close()

    thread = threading.Thread(target=lambda: asyncio.run(live()), daemon=True)
    thread.start()
    assert ready.wait(20)
    yield end, all_of_them
    closing.set()
    thread.join(20)


def farm_at(end):
    return Farm.model_validate(
        {
            "operator": "Ada",
            "router": end,
            "vehicles": [{"name": name} for name in VEHICLES],
            "turbines": [{"name": name, "rotor_locked": True} for name in TURBINES],
        }
    )


def test_a_run_that_is_ended_midway_goes_on_and_every_turbine_is_flown_once(
    pretenders, tmp_path, monkeypatch
):
    monkeypatch.setattr(farm_run, "TURN_S", 0.05)
    end, vehicles = pretenders
    told = []
    with FarmRun(farm_at(end), tmp_path / "ledger.json", tell=told.append) as first:
        deadline = time.monotonic() + 30
        while sum(r.stage is Stage.COMPLETED for r in first.ledger.turbines.values()) < 3:
            assert time.monotonic() < deadline, told
            first.step()
            time.sleep(0.05)
    flying = [r for r in first.ledger.turbines.values() if r.stage is Stage.FLYING]
    assert flying, "it is ended while missions fly"
    with FarmRun(farm_at(end), tmp_path / "ledger.json", tell=told.append) as second:
        assert second.ledger == first.ledger
        done = second.run()
    assert {done.of(name).stage for name in TURBINES} == {Stage.COMPLETED}
    flown = Counter(site for vehicle in vehicles for site in vehicle.flown)
    assert flown == Counter(TURBINES)
    assert all(vehicle.flown for vehicle in vehicles)


def test_a_start_whose_reply_was_lost_is_sent_again_and_starts_no_second_mission(
    pretenders, tmp_path, monkeypatch
):
    monkeypatch.setattr(farm_run, "TURN_S", 0.05)
    end, vehicles = pretenders
    with FarmRun(farm_at(end), tmp_path / "ledger.json", tell=lambda _: None) as run:
        deadline = time.monotonic() + 30
        while not any(record.mission_dir for record in run.ledger.turbines.values()):
            assert time.monotonic() < deadline
            run.step()
        name, record = next(
            (name, record) for name, record in run.ledger.turbines.items() if record.mission_dir
        )
        run._keep(run.ledger.with_record(name, mission_dir=""))
        run.step()
        assert run.ledger.of(name).mission_dir == record.mission_dir
    assert [site for one in vehicles for site in one.flown].count(name) == 1


def test_two_hundred_vehicles_are_kept_in_sight(pretenders):
    """A state of each, five times a second, costs the ground less than half of a core."""
    end, _ = pretenders
    state = StateMessage(
        vehicle="x",
        mission_dir="",
        site="",
        mission_s=1.0,
        factor=1.0,
        progress=Progress(Phase.TRACK, MissionState.RUNNING, "words"),
    )
    payload = state.model_dump_json().encode()
    with (
        Fleet(BusSettings(listen=end)) as fleet,
        Bus.open_client(BusSettings(listen=end), "x") as sender,
    ):
        time.sleep(0.3)
        before_s = time.thread_time(), time.process_time()
        for _ in range(10):
            for number in range(200):
                sender._session.put(f"bladescout/v{number}/mission/state", payload)
            time.sleep(0.05)
        deadline = time.monotonic() + 20
        while len([n for n in fleet.vehicles() if n.startswith("v")]) < 200:
            assert time.monotonic() < deadline
            time.sleep(0.05)
        # Sending and routing are counted in: what is left for hearing is less than all of it.
        per_message_s = (time.process_time() - before_s[1]) / 2000
    assert per_message_s * 200 * 5 < 0.5
