"""The supervisor tells a recorder that is behind which mission is under way."""

import json
from pathlib import Path

import pytest

from config.settings import Settings
from drivers.bus import Key, Sample
from mission.flight.observation import RequestKind
from mission.processes.supervisor import Supervisor
from mission.remote.messages import Intent, ReadyMessage


class Bus:
    def __init__(self):
        self.said = []

    def publish(self, key, payload, **_):
        self.said.append((key, json.loads(payload)))


def ready(name, recording=""):
    message = ReadyMessage(name=name, recording=recording)
    return Sample(Key.READY, message.model_dump_json().encode(), None)


@pytest.fixture
def supervisor(tmp_path, monkeypatch):
    supervisor = Supervisor(Settings(), Path(tmp_path))
    supervisor._bus = Bus()
    monkeypatch.setattr(type(supervisor._desk), "under_way", True)
    return supervisor


def test_a_recorder_that_missed_the_start_is_told_of_it(supervisor):
    start = Intent(kind=RequestKind.START, id="1", site="a", mission_dir="missions/a")
    supervisor._take_ready(ready("recorder"))
    assert supervisor._bus.said == []
    supervisor._hand_over(start)
    supervisor._take_ready(ready("tracking"))
    supervisor._take_ready(ready("recorder", "missions/a"))
    supervisor._take_ready(ready("recorder"))
    assert [key for key, _ in supervisor._bus.said] == [Key.INTENT, Key.RECORD]
    assert supervisor._bus.said[1][1]["mission_dir"] == "missions/a"


def test_once_the_mission_is_over_nothing_is_told(supervisor, monkeypatch):
    monkeypatch.setattr(type(supervisor._desk), "under_way", False)
    supervisor._hand_over(Intent(kind=RequestKind.START, id="1", site="a", mission_dir="m"))
    supervisor._take_ready(ready("recorder"))
    assert [key for key, _ in supervisor._bus.said] == [Key.INTENT]
