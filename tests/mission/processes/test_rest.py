from mission.flight.command import MissionState, Phase, Progress
from mission.flight.observation import RequestKind
from mission.processes.rest import Rest
from mission.remote.messages import Intent, StateMessage

NOW_S = 100.0


class Clock:
    def __init__(self):
        self.s = NOW_S

    def now_s(self):
        return self.s


class Bus:
    def __init__(self):
        self.takers = {}

    def subscribe(self, key, take):
        self.takers[key] = take


class Told:
    """Rest, with what it told somebody."""

    def __init__(self):
        self.bus, self.clock, self.heard = Bus(), Clock(), []
        self.rest = Rest(self.bus, self.clock)
        self.rest.tell(self.heard.append)

    def state(self, *, resting):
        message = StateMessage(
            vehicle="heron",
            mission_dir="",
            site="",
            mission_s=self.clock.s,
            factor=1.0,
            progress=Progress(Phase.IDLE, MissionState.IDLE, "ready"),
            resting=resting,
        )
        self._hand("mission/state", message)

    def asked(self, kind):
        self._hand("mission/intent", Intent(id="1", kind=kind))

    def _hand(self, key, message):
        class Sample:
            payload = message.model_dump_json().encode()

        self.bus.takers[key](Sample)


def test_nothing_rests_before_flight_has_said_so():
    told = Told()
    told.state(resting=False)
    assert told.heard == [False]


def test_everybody_is_told_of_each_change_once():
    told = Told()
    for resting in (True, True, False, False, True):
        told.clock.s += 2.0
        told.state(resting=resting)
    assert told.heard == [False, True, False, True]


def test_a_start_ends_the_rest_before_flight_has_said_anything():
    told = Told()
    told.state(resting=True)
    told.asked(RequestKind.START)
    assert told.heard == [False, True, False]
    assert told.rest.woke_s == NOW_S


def test_a_state_from_before_the_start_does_not_put_it_to_rest_again():
    told = Told()
    told.state(resting=True)
    told.asked(RequestKind.START)
    told.clock.s += 0.1
    told.state(resting=True)
    assert not told.rest.resting
    told.clock.s += 2.0
    told.state(resting=True)
    assert told.rest.resting


def test_an_abort_in_a_rest_wakes_nobody():
    told = Told()
    told.state(resting=True)
    told.asked(RequestKind.ABORT)
    assert told.rest.resting
