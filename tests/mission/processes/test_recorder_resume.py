"""A mission folder that is gone on with: what an earlier flight, or recorder, left behind."""

import asyncio
import dataclasses
import json

import pytest

from config.settings import Settings
from config.turbine import Site
from drivers.bus import Key
from drivers.clock import MonotonicClock
from mission.flight.command import MissionState, Phase
from mission.flight.observation import BladeEstimate, RequestKind, RotorEstimate
from mission.flight.report import PassReport, PhaseTime
from mission.processes.recorder import Recorder
from mission.processes.runtime import Runtime
from mission.records.flights import read_flights
from mission.remote.messages import Intent
from tests.mission.processes.test_recorder import HandBus, camera, taken, the_end, until

__all__ = ["camera"]


def side(photos, distance_m, clearance_m, skipped=False):
    return PassReport(
        "A", "PS", 30.0, 30.0, 4.0 * photos, distance_m, 0.3, distance_m - 0.5, clearance_m,
        photos, 0, (), skipped,
    )  # fmt: skip


def flown(state, photos, begin_s, end_s, distance_m=12.0, clearance_m=10.0, angle_deg=20.0):
    """Return what flight tells of itself."""
    whole = the_end()
    report = dataclasses.replace(
        whole.report, state=state, words="as told", duration_s=end_s - begin_s,
        phases=(PhaseTime(Phase.IDLE, 0.0, begin_s), PhaseTime(Phase.TRACK, begin_s, end_s)),
        rotor=RotorEstimate(
            begin_s, 1, stop_angle_deg=angle_deg, sigma_deg=0.2,
            blades=tuple(BladeEstimate(name, (0.0, 0.0, 1.0), 2.0) for name in "ABC"),
        ),
        passes=(side(photos, distance_m, clearance_m),),
        swap=state is MissionState.ENDED_SAFELY,
    )  # fmt: skip
    return whole.model_copy(update={"report": report})


async def one_flight(tmp_path, number, photo_ids, camera, *reports):
    """Record a flight; what is not ended by a report is killed. Returns what was said."""
    site = Site(name="hill-3", turbine="windpact-1.5")
    runtime = Runtime(Settings(sites=(site,)), MonotonicClock(), tmp_path)
    bus, folder = HandBus(), tmp_path / "mission"
    folder.mkdir(exist_ok=True)
    running = asyncio.create_task(Recorder(runtime, bus).run())
    await asyncio.sleep(0)
    intent = Intent(
        kind=RequestKind.START, id=f"r{number}", site="hill-3", mission_dir=str(folder),
        flight=number, operator=f"person {number}",
    )  # fmt: skip
    bus.deliver(Key.INTENT, intent)
    if number > 1:
        await until(lambda: any(key == Key.EARLIER for key, _ in bus.said))
    before = sum(key == Key.PHOTO_RESULT for key, _ in bus.said)
    for photo_id in photo_ids:
        bus.deliver(Key.PHOTO, taken(photo_id, camera))
    answers = before + len(photo_ids)
    await until(lambda: sum(key == Key.PHOTO_RESULT for key, _ in bus.said) == answers)
    for key, report in reports:
        bus.deliver(key, report)
        if key == Key.REPORT:
            await until(lambda: any(k == Key.RECORDED for k, _ in bus.said))
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    return bus.said


async def three_flights(tmp_path, camera):
    """The battery ends the first, the second is killed, the third completes."""
    ended, running = MissionState.ENDED_SAFELY, MissionState.RUNNING
    first = flown(ended, 2, 10.0, 110.0, clearance_m=9.4)
    await one_flight(tmp_path, 1, (1, 2), camera, (Key.REPORT, first))
    camera.missing = {"/4"}
    second = flown(running, 3, 200.0, 250.0, 12.4, angle_deg=20.2)
    await one_flight(tmp_path, 2, (3, 4), camera, (Key.JOURNAL, second))
    camera.missing = set()
    # The companion computer was switched off: its clock counts from 0 again.
    third = flown(MissionState.COMPLETED, 5, 5.0, 65.0, 11.8, angle_deg=19.8)
    return await one_flight(tmp_path, 3, (5,), camera, (Key.REPORT, third))


@pytest.fixture
def told(tmp_path, camera, monkeypatch):
    monkeypatch.setattr("mission.records.photos.FETCH_WAIT_S", 0.0)
    said = asyncio.run(three_flights(tmp_path, camera))
    mission = json.loads((tmp_path / "mission" / "mission.json").read_text())
    return said, mission, tmp_path / "mission"


def test_the_next_flight_is_told_of_every_photo_and_one_that_waited_is_fetched(told):
    said, _, folder = told
    (earlier,) = [message["earlier"] for key, message in said if key == Key.EARLIER]
    assert earlier["flights"] == 2
    assert [photo["photo_id"] for photo in earlier["photos"]] == [1, 2, 3, 4]
    assert earlier["next_photo_id"] == 5
    assert earlier["stop_angle_deg"] == 20.0
    assert not list((folder / "pending").glob("*.json"))


def test_one_folder_tells_of_all_flights(told):
    _, mission, folder = told
    assert mission["state"] == "completed"
    assert [one["state"] for one in mission["flights"]] == [
        "ended_safely",
        "broken_off",
        "completed",
    ]
    assert [one["operator"] for one in mission["flights"]] == ["person 1", "person 2", "person 3"]
    assert mission["swaps"] == 1
    assert mission["photos"] == {"kept": 5, "rejected": 0, "lost": 0}
    assert mission["duration_s"] == 100.0 + 50.0 + 60.0
    assert mission["rotor"]["stop_angle_deg"] == 20.0
    (ps,) = mission["passes"]
    assert ps["photos"] == 5
    assert ps["clearance_m"]["min"] == 9.4
    assert 11.8 < ps["distance_m"]["mean"] < 12.4
    times = [phase["from_s"] for phase in mission["phases"]]
    assert times == sorted(times)
    assert [one.number for one in read_flights(folder)] == [1, 2, 3]
    assert "flights" in (folder / "report.html").read_text().lower()


async def killed_while_fetching(tmp_path, camera):
    """A recorder is gone before a photo is there; the next one, in the same flight, gets it."""
    camera.missing = {"/2"}
    await one_flight(tmp_path, 1, (1, 2), camera)
    camera.missing = set()
    end = flown(MissionState.COMPLETED, 2, 10.0, 60.0)
    site = Site(name="hill-3", turbine="windpact-1.5")
    runtime = Runtime(Settings(sites=(site,)), MonotonicClock(), tmp_path)
    bus, folder = HandBus(), tmp_path / "mission"
    running = asyncio.create_task(Recorder(runtime, bus).run())
    await asyncio.sleep(0)
    start = Intent(kind=RequestKind.START, id="r1", site="hill-3", mission_dir=str(folder))
    bus.deliver(Key.RECORD, start)
    await until(lambda: any(key == Key.PHOTO_RESULT for key, _ in bus.said))
    bus.deliver(Key.REPORT, end)
    await until(lambda: any(k == Key.RECORDED for k, _ in bus.said))
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    return bus.said


def test_a_recorder_that_comes_back_fetches_what_the_one_before_could_not(
    tmp_path, camera, monkeypatch
):
    monkeypatch.setattr("mission.records.photos.FETCH_WAIT_S", 0.0)
    said = asyncio.run(killed_while_fetching(tmp_path, camera))
    results = [message for key, message in said if key == Key.PHOTO_RESULT]
    assert [(one["photo_id"], one["kept"]) for one in results] == [(2, True)]
    mission = json.loads((tmp_path / "mission" / "mission.json").read_text())
    assert mission["photos"]["kept"] == 2
