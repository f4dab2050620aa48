import json

import pytest

from config.settings import Settings
from config.turbine import Site
from mission.flight.command import MissionState, Phase, Progress
from mission.processes.supervisor import Supervisor
from mission.remote.messages import StateMessage


class BusOfPaper:
    def __init__(self):
        self.published = []
        self.answers = {}

    def publish(self, key, payload, **_):
        self.published.append((key, json.loads(payload)))

    def answer(self, key, on_request):
        self.answers[key] = on_request


class Asker:
    """A supervisor without processes, asked directly."""

    def __init__(self, tmp_path):
        settings = Settings(
            missions_dir=str(tmp_path / "missions"),
            sites=(Site(name="one", turbine="windpact-1.5"),),
        )
        self.supervisor = Supervisor(settings, tmp_path / "run")
        self.bus = BusOfPaper()
        self.supervisor._bus = self.bus
        self.supervisor._serve_requests(self.bus)

    def ask(self, key, request):
        raw = request if isinstance(request, bytes) else json.dumps(request).encode()
        return json.loads(self.bus.answers[f"rpc/{key}"](raw))

    def hear(self, state, mission_dir=""):
        message = StateMessage(
            vehicle="drone-1",
            mission_dir=mission_dir,
            site="one",
            mission_s=1.0,
            factor=1.0,
            progress=Progress(Phase.IDLE, state, "words"),
        )
        sample = type("S", (), {"payload": message.model_dump_json().encode()})
        self.supervisor._take_state(sample)

    @property
    def intents(self):
        return [payload for key, payload in self.bus.published if key == "mission/intent"]


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
