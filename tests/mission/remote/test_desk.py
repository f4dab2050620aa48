import json
import time

import pytest

from config.settings import Settings
from config.turbine import Site
from drivers.bus import Ask, Key, Sample
from drivers.bus_access import ALL_VERBS, LOCAL, Role
from mission.flight.command import MissionState, Phase, PhotoCommand, Progress
from mission.remote.desk import Desk
from mission.remote.history import MAX_EVENTS, History
from mission.remote.messages import (
    Code,
    EventMessage,
    PhotoResultMessage,
    PhotoTakenMessage,
    StateMessage,
)

ROLES = {"eve": Role.VIEWER, "ada": Role.OPERATOR, "pia": Role.PILOT, "heron": Role.VEHICLE}


class Asker:
    """A desk without a bus, asked directly."""

    def __init__(self, tmp_path, roles=ROLES):
        settings = Settings(
            missions_dir=str(tmp_path / "missions"),
            sites=(Site(name="one", turbine="windpact-1.5", tower_north_m=80),),
        )
        self.intents, self.told = [], []
        self.history = History()
        self.desk = Desk(
            settings,
            self.history,
            lambda intent: self.intents.append(intent.model_dump()),
            self.told.append,
            dict(roles),
        )

    def ask(self, key, request, who=LOCAL):
        raw = request if isinstance(request, bytes) else json.dumps(request).encode()
        return json.loads(self.desk.answer(Ask(key, who, raw)))

    def put(self, key, message):
        self.history.take(Sample(key, message.model_dump_json().encode(), None))

    def hear(self, state, mission_dir=""):
        message = StateMessage(
            vehicle="drone-1",
            mission_dir=mission_dir,
            site="one",
            mission_s=1.0,
            factor=1.0,
            progress=Progress(Phase.IDLE, state, "words"),
        )
        self.put(Key.STATE, message)
        self.desk.take_state(message)


START = {"id": "a", "site": "one", "operator": "Ada", "rotor_locked": True}


@pytest.fixture
def asker(tmp_path):
    asker = Asker(tmp_path)
    asker.hear(MissionState.IDLE)
    return asker


def test_a_good_request_starts_one_mission_and_makes_its_folder(asker, tmp_path):
    reply = asker.ask("start", START)
    assert reply["ok"]
    assert reply["code"] == "started"
    assert [intent["kind"] for intent in asker.intents] == ["start"]
    assert (tmp_path / "missions").is_dir()
    assert reply["mission_dir"].endswith("-one")


def test_the_same_request_again_starts_no_second_mission(asker):
    first = asker.ask("start", START)
    again = asker.ask("start", START)
    assert again["code"] == "already_started"
    assert again["mission_dir"] == first["mission_dir"]
    assert len(asker.intents) == 1


def test_a_hundred_starts_give_one_mission(asker):
    replies = [asker.ask("start", START | {"id": f"r{n}"}) for n in range(100)]
    assert sum(reply["ok"] for reply in replies) == 1
    assert {reply["code"] for reply in replies} == {"started", "busy"}


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"site": "two"}, "unknown_turbine"),
        ({"rotor_locked": False}, "not_confirmed"),
        ({"expires_utc_s": 1.0}, "expired"),
        ({"version": 2}, "bad_request"),
        ({"operator": ""}, "bad_request"),
        ({"extra": 1}, "bad_request"),
        ({"id": "a/**"}, "bad_request"),
        ({"blades": ["D"]}, "bad_request"),
        ({"nacelle_yaw_deg": 360.0}, "bad_request"),
        ({"blade_pitch_deg": 120.0}, "bad_request"),
        ({"blade_serials": {"D": "x"}}, "bad_request"),
        ({"launch_enu_m": [1.0, 2.0]}, "bad_request"),
    ],
)
def test_a_request_that_cannot_be_is_refused_with_a_stable_code(asker, change, code):
    reply = asker.ask("start", START | change)
    assert not reply["ok"]
    assert reply["code"] == code
    assert asker.intents == []


@pytest.mark.parametrize(
    "raw",
    [b"", b"nonsense", b"[" * 100_000, b'{"id": NaN}', b"\xff\xfe", b"x" * 1_000_000, b"null"],
)
def test_bytes_that_are_no_request_get_an_error_reply(asker, raw):
    for key in ("start", "abort", "status"):
        assert asker.ask(key, raw)["code"] in ("bad_request", "too_large")
    assert asker.intents == []


def test_an_unknown_turbine_is_answered_with_those_that_are_known(asker):
    assert "known: one" in asker.ask("start", START | {"site": "two"})["text"]
    assert "did you mean 'one'?" in asker.ask("start", START | {"site": "onne"})["text"]


@pytest.mark.parametrize("kind", ["pause", "resume", "skip", "stop", "abort"])
def test_nothing_can_be_asked_of_a_mission_that_does_not_run(asker, kind):
    assert asker.ask(kind, {"id": "x"})["code"] == "not_running"
    assert asker.intents == []


@pytest.mark.parametrize("kind", ["pause", "resume", "skip", "stop", "abort"])
def test_a_running_mission_is_handed_what_is_asked(asker, kind):
    asker.hear(MissionState.RUNNING)
    assert asker.ask(kind, {"id": "x"})["ok"]
    assert [intent["kind"] for intent in asker.intents] == [kind]


def test_before_flight_is_up_a_start_is_told_to_come_again(tmp_path):
    assert Asker(tmp_path).ask("start", START)["code"] == "not_ready"


def test_the_same_id_with_other_content_is_no_repetition(asker):
    asker.ask("start", START)
    assert asker.ask("start", START | {"operator": "Bea"})["code"] == Code.ID_REUSED
    assert len(asker.intents) == 1


def test_the_same_request_after_the_daemon_began_anew_starts_no_second_mission(asker, tmp_path):
    first = asker.ask("start", START)
    folder = tmp_path / "missions" / "broken"
    folder.mkdir()
    (folder / "request.json").write_text("half a re")
    anew = Asker(tmp_path)
    anew.hear(MissionState.IDLE)
    again = anew.ask("start", START)
    assert (again["code"], again["mission_dir"]) == (Code.ALREADY_STARTED, first["mission_dir"])
    assert anew.intents == []
    assert anew.ask("start", START | {"id": "b"})["code"] == Code.STARTED


def test_a_dry_run_is_checked_like_any_other_and_starts_nothing(asker, tmp_path):
    reply = asker.ask("start", START | {"dry_run": True, "blades": ["B"], "sides": ["LE"]})
    assert reply["ok"]
    assert reply["code"] == Code.WOULD_START
    assert "LE of B at one" in reply["text"]
    assert asker.intents == []
    assert not (tmp_path / "missions").exists()
    refused = asker.ask("start", START | {"dry_run": True, "rotor_locked": False})
    assert refused["code"] == Code.NOT_CONFIRMED
    assert asker.ask("start", START)["code"] == Code.STARTED


def test_what_the_operator_knows_reaches_flight(asker):
    known = {
        "nacelle_yaw_deg": 275.0,
        "blade_pitch_deg": 88.0,
        "blade_serials": {"A": "LM-1", "C": "LM-3"},
        "launch_enu_m": [-20.0, -70.0, 1.5],
    }
    asker.ask("start", START | known)
    (intent,) = asker.intents
    assert {name: intent[name] for name in known} == known | {"launch_enu_m": (-20.0, -70.0, 1.5)}


@pytest.mark.parametrize(
    ("who", "may"),
    [
        ("eve", {"status", "turbines", "history"}),
        ("pia", {"status", "turbines", "history", "pause", "stop", "abort"}),
        ("ada", set(ALL_VERBS)),
        (LOCAL, set(ALL_VERBS)),
        ("heron", set()),
        ("nobody", set()),
    ],
)
def test_each_role_may_ask_its_own(asker, who, may):
    asker.hear(MissionState.RUNNING)
    answers = {verb: asker.ask(verb, {"id": "x"}, who)["code"] for verb in ALL_VERBS}
    assert {verb for verb, code in answers.items() if code != Code.NOT_ALLOWED} == may


def test_who_asked_and_what_became_of_it_is_told(asker):
    asker.ask("start", START, "eve")
    asker.ask("start", START, "ada")
    asker.ask("status", {"id": "x"}, "eve")
    assert [event.text for event in asker.told] == [
        "eve asked to start: refused (not_allowed)",
        "ada asked to start: accepted",
    ]


def test_a_running_mission_is_what_it_is_after_flight_died(asker):
    asker.ask("start", START)
    assert asker.ask("start", START | {"id": "b"})["code"] == Code.BUSY
    asker.desk.forget_pending()
    assert asker.ask("start", START | {"id": "b"})["code"] == Code.STARTED


def test_the_turbines_are_listed_with_their_sizes_and_places(asker):
    (turbine,) = asker.ask("turbines", {"id": "x"})["turbines"]
    assert turbine["name"] == "one"
    assert turbine["tower_enu_m"] == [0.0, 80.0, 0.0]
    assert turbine["rotor_diameter_m"] == pytest.approx(70, abs=1)


def photo(number, metre):
    return PhotoTakenMessage(
        command=PhotoCommand(number, "A", "PS", metre, 12.0),
        url="",
        index=number,
        stamp_s=1.0,
        utc="",
        position_w=(0, 0, 0),
        quaternion_wb=(1, 0, 0, 0),
        gimbal_yaw_rad=0.0,
        gimbal_pitch_rad=0.0,
    )


def test_a_late_joiner_is_told_state_events_and_photos(asker):
    asker.ask("start", START)
    for number in range(MAX_EVENTS + 5):
        event = EventMessage(mission_s=number, name="x", severity="info", text="x")
        asker.put(Key.EVENT, event)
    for number, metre in ((0, 3.0), (1, 6.0), (2, 9.0)):
        asker.put(Key.PHOTO, photo(number, metre))
    asker.put(Key.PHOTO_RESULT, PhotoResultMessage(photo_id=0, kept=True))
    asker.put(Key.PHOTO_RESULT, PhotoResultMessage(photo_id=1, kept=False))
    asker.put(Key.PHOTO_RESULT, PhotoResultMessage(photo_id=77, kept=True))
    told = asker.ask("history", {"id": "x"})
    assert told["state"]["progress"]["state"] == "idle"
    assert [told["events"][0]["mission_s"], told["events"][-1]["mission_s"]] == [5, MAX_EVENTS + 4]
    assert [(p["metre"], p["kept"]) for p in told["photos"]] == [
        (3.0, True),
        (6.0, False),
        (9.0, None),
    ]


def test_a_verdict_may_come_before_its_photo(asker):
    asker.put(Key.PHOTO_RESULT, PhotoResultMessage(photo_id=4, kept=True))
    asker.put(Key.PHOTO, photo(4, 3.0))
    assert asker.ask("history", {"id": "x"})["photos"][0]["kept"] is True


def test_a_new_mission_begins_without_the_photos_of_the_last(asker):
    asker.put(Key.PHOTO, photo(0, 3.0))
    asker.ask("start", START)
    assert asker.ask("history", {"id": "x"})["photos"] == []


def test_any_reply_takes_a_small_part_of_fifty_milliseconds(asker):
    for number in range(MAX_EVENTS):
        asker.put(Key.EVENT, EventMessage(mission_s=number, name="x", severity="info", text="x"))
    for number in range(400):
        asker.put(Key.PHOTO, photo(number, 3.0))
    begun = time.process_time()
    for _ in range(20):
        for verb in ALL_VERBS:
            asker.ask(verb, {"id": "x"})
    assert (time.process_time() - begun) / (20 * len(ALL_VERBS)) < 0.02
