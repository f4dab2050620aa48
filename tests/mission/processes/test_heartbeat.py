import asyncio

import pytest

from mission.flight.command import MissionState, Phase, Progress
from mission.processes import heartbeat
from mission.processes.heartbeat import feed_watchdog
from mission.remote.history import History
from mission.remote.messages import StateMessage


class Listening:
    listens = True
    watchdog_s = 0.05

    def __init__(self):
        self.said = []

    def ready(self, words):
        self.said.append(("ready", words))

    def alive(self, words):
        self.said.append(("alive", words))

    def stopping(self):
        self.said.append(("stopping",))


class Heard(History):
    age_s = 0.0

    def state_age_s(self):
        return self.age_s


@pytest.fixture
def history():
    history = Heard()
    history.state = StateMessage(
        vehicle="heron",
        mission_dir="",
        site="",
        mission_s=1.0,
        factor=1.0,
        progress=Progress(Phase.IDLE, MissionState.IDLE, "ready"),
    )
    return history


async def said_by(systemd, count):
    while len(systemd.said) < count:  # noqa: ASYNC110 - a list that fills tells nobody
        await asyncio.sleep(0.01)


async def fed(history, during):
    systemd = Listening()
    task = asyncio.create_task(feed_watchdog(history, systemd))
    await during(systemd)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    return systemd.said


async def test_the_watchdog_is_fed_while_ticks_arrive_and_not_after(history):
    async def during(systemd):
        await said_by(systemd, 3)
        history.age_s = heartbeat.TICKS_WITHIN_S + 0.1
        await asyncio.sleep(0.05)
        systemd.said.clear()
        await asyncio.sleep(0.15)

    assert await fed(history, during) == [("stopping",)]


async def test_ready_is_said_once_and_only_after_the_first_tick(history):
    state, history.state = history.state, None

    async def during(systemd):
        await asyncio.sleep(0.1)
        assert systemd.said == []
        history.state = state
        await said_by(systemd, 4)

    said = await fed(history, during)
    assert said[0] == ("ready", "idle: ready")
    assert [word for word, *_ in said].count("ready") == 1
