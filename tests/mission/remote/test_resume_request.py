"""What `resume` is answered: after a pause, and where a mission ended unfinished."""

import json

import pytest

from mission.flight.command import MissionState, Phase, Progress
from mission.flight.report import MissionReport, PhaseTime
from mission.records.flights import FlightRecord, write_flight
from mission.remote.messages import FlightReport, Intent, StateMessage
from tests.mission.remote.test_desk import START, Asker

RESUME = {"id": "b", "operator": "Bea", "rotor_locked": True}


@pytest.fixture
def asker(tmp_path):
    """A desk whose daemon has just come up."""
    asker = Asker(tmp_path)
    asker.hear(MissionState.IDLE)
    return asker


def ended(folder, number, state, words="landed"):
    """Write down how a flight ended; None: it never told."""
    report = MissionReport(
        state=state or MissionState.RUNNING, words=words, started_s=0.0, duration_s=60.0,
        phases=(PhaseTime(Phase.IDLE, 0.0, 60.0),), rotor=None, iterations=0, passes=(), events=(),
    )  # fmt: skip
    message = FlightReport(
        report=report, site="one", turbine="windpact-1.5", operator="Ada", rotor_locked=True,
        started_utc="2026-03-01T10:14:00+00:00", tower_foot_w=(0.0, 0.0, 0.0),
    )  # fmt: skip
    intent = Intent(
        kind="start", id=f"f{number}", site="one", operator="Ada", blades=("A",), sides=("LE",),
        mission_dir=str(folder), flight=number,
    )  # fmt: skip
    record = FlightRecord(number=number, intent=intent, report=message, ended=state is not None)
    write_flight(folder, record)


@pytest.fixture
def folder(asker, tmp_path):
    """A mission that another daemon has begun."""
    earlier = Asker(tmp_path)
    earlier.hear(MissionState.IDLE)
    reply = earlier.ask("start", START | {"blade_serials": {"A": "SN-1"}})
    return tmp_path / "missions" / reply["mission_dir"].rsplit("/", 1)[1]


@pytest.mark.parametrize(
    "state", [None, MissionState.ENDED_SAFELY, MissionState.RELEASED, MissionState.FAILED]
)
def test_a_mission_that_did_not_complete_goes_on_with_its_next_flight(asker, folder, state):
    ended(folder, 1, state)
    reply = asker.ask("resume", RESUME)
    assert reply["code"] == "resumed"
    assert reply["mission_dir"] == str(folder)
    (intent,) = asker.intents
    assert intent["kind"] == "start"
    assert intent["flight"] == 2
    assert intent["operator"] == "Bea"
    # What the first flight was handed, not what is configured by now.
    assert intent["blades"] == ("A",)
    assert intent["sides"] == ("LE",)
    assert intent["blade_serials"] == {"A": "SN-1"}


def test_a_flight_that_was_killed_before_it_wrote_anything_is_begun_anew(asker, folder):
    assert asker.ask("resume", RESUME)["code"] == "resumed"
    assert asker.intents[0]["flight"] == 1


def test_a_completed_mission_is_not_flown_again(asker, folder):
    ended(folder, 1, MissionState.COMPLETED)
    reply = asker.ask("resume", RESUME)
    assert reply["code"] == "not_resumable"
    assert "completed" in reply["text"]
    assert asker.intents == []


@pytest.mark.parametrize("missing", [{"operator": ""}, {"rotor_locked": False}])
def test_the_word_for_the_rotor_is_given_anew(asker, folder, missing):
    reply = asker.ask("resume", RESUME | missing)
    assert reply["code"] == "not_confirmed"
    assert folder.name in reply["text"]
    assert asker.intents == []


def test_the_same_request_again_begins_no_second_flight(asker, folder):
    first = asker.ask("resume", RESUME)
    flight = asker.intents[0]
    write_flight(folder, FlightRecord(number=flight["flight"], intent=Intent(**flight)))
    again = asker.ask("resume", RESUME)
    assert again["code"] == "already_started"
    assert again["mission_dir"] == first["mission_dir"]
    assert len(asker.intents) == 1


def test_an_older_one_is_resumed_by_its_name_only(asker, folder, tmp_path):
    ended(folder, 1, MissionState.ENDED_SAFELY)
    newer = tmp_path / "missions" / "99991231T000000Z-one"
    newer.mkdir()
    (newer / "request.json").write_bytes((folder / "request.json").read_bytes())
    ended(newer, 1, MissionState.COMPLETED)
    assert asker.ask("resume", RESUME)["code"] == "not_resumable"
    reply = asker.ask("resume", RESUME | {"mission": folder.name})
    assert reply["mission_dir"] == str(folder)


@pytest.mark.parametrize("name", ["../elsewhere", "/etc", "..", "a/b"])
def test_a_name_leads_nowhere_else(asker, folder, name):
    assert asker.ask("resume", RESUME | {"mission": name})["code"] == "bad_request"


def test_what_is_under_way_is_not_resumed_from_its_folder(asker, folder):
    asker.hear(MissionState.PAUSED, str(folder))
    assert asker.ask("resume", RESUME | {"mission": folder.name})["code"] == "busy"
    assert asker.ask("resume", {"id": "x"})["code"] == "accepted"
    assert asker.intents[-1]["kind"] == "resume"


def test_the_end_of_the_flight_before_is_not_taken_for_the_end_of_the_next(asker, folder):
    ended(folder, 1, MissionState.ENDED_SAFELY)
    asker.hear(MissionState.ENDED_SAFELY, str(folder))
    asker.ask("resume", RESUME)
    asker.hear(MissionState.ENDED_SAFELY, str(folder))
    assert asker.desk.under_way
    progress = Progress(Phase.LANDED, MissionState.ENDED_SAFELY, "words", flight=2)
    told = StateMessage(
        vehicle="drone-1", mission_dir=str(folder), site="one", mission_s=1.0, factor=1.0,
        progress=progress,
    )  # fmt: skip
    asker.history.state = told
    asker.desk.take_state(told)
    assert not asker.desk.under_way


def test_a_dry_run_only_says_what_it_would_do(asker, folder):
    ended(folder, 1, None)
    reply = asker.ask("resume", RESUME | {"dry_run": True})
    assert reply["code"] == "would_start"
    assert f"flight 2 of {folder.name}" in reply["text"]
    assert asker.intents == []


def test_a_journal_that_is_torn_is_passed_over(asker, folder):
    ended(folder, 1, MissionState.ENDED_SAFELY)
    (folder / "flights" / "2.json").write_text(json.dumps({"number": 2})[:9])
    assert asker.ask("resume", RESUME)["ok"]
    assert asker.intents[0]["flight"] == 3
