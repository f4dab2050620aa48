"""What flight is told of earlier flights, and what it tells for the journal."""

import json
import time

import pytest

from config.settings import Settings
from config.turbine import Site
from drivers.bus import Key, Sample
from drivers.clock import MonotonicClock
from mission.flight.command import Phase
from mission.flight.earlier import Earlier
from mission.flight.observation import RequestKind
from mission.processes.flight import Flight
from mission.processes.runtime import Runtime
from mission.remote.messages import EarlierMessage, FlightReport, Intent
from tests.mission.flight.test_resumption import mission


class HandBus:
    """A bus that keeps what is published, and delivers what the test says."""

    def __init__(self):
        self.said, self.takers = [], {}

    def subscribe(self, key, take):
        self.takers[key] = take

    subscribe_newest = subscribe

    def publish(self, key, payload, **_):
        self.said.append((key, payload))

    def deliver(self, key, message):
        self.takers[key](Sample(key, message.model_dump_json().encode(), None))


@pytest.fixture
def flight(tmp_path):
    site = Site(name="t1", turbine="v27", tower_north_m=46.5)
    runtime = Runtime(Settings(sites=(site,)), MonotonicClock(), tmp_path)
    return Flight(runtime, HandBus())


def intent(number):
    return Intent(
        kind=RequestKind.START, id=f"r{number}", site="t1", mission_dir="/missions/a",
        rotor_locked=True, flight=number, airborne=True, rendezvous_w=(1.0, 2.0, 30.0),
    )  # fmt: skip


def earlier(number, folder="/missions/a"):
    return EarlierMessage(
        mission_dir=folder, flight=number, earlier=Earlier(number - 1, 17, stop_angle_deg=20.0)
    )


def test_what_earlier_flights_left_behind_is_observed_once(flight):
    flight._bus.deliver(Key.INTENT, intent(2))
    (request,) = flight._asked.requests()
    assert (request.flight, request.airborne, request.rendezvous_w) == (2, True, (1.0, 2.0, 30.0))
    flight._bus.deliver(Key.EARLIER, earlier(2))
    assert flight._asked.earlier().next_photo_id == 17
    assert flight._asked.earlier() is None


@pytest.mark.parametrize("wrong", [earlier(3), earlier(2, "/missions/b")])
def test_what_is_told_for_another_flight_is_not_believed(flight, wrong):
    flight._bus.deliver(Key.INTENT, intent(2))
    flight._bus.deliver(Key.EARLIER, wrong)
    assert flight._asked.earlier() is None


def test_the_journal_of_a_flight_is_cheap_and_can_be_read_again(flight):
    flown = mission(sides=("PS",), blades=("A",))
    flown.run(until=Phase.TRACK)
    flight._bus.deliver(Key.INTENT, intent(1))
    flight._keep_journal(flown.machine)
    begun_s = time.process_time()
    for _ in range(20):
        flight._keep_journal(flown.machine)
    took_s = (time.process_time() - begun_s) / 20
    journals = [payload for key, payload in flight._bus.said if key == Key.JOURNAL]
    report = FlightReport.model_validate_json(journals[-1])
    assert report.report.rotor.stop_angle_deg == pytest.approx(20.0, abs=0.5)
    assert report.report.passes[0].coverage is None
    assert json.loads(journals[-1])["site"] == "t1"
    # A tenth of a tick, once in a hundred.
    assert took_s < 0.005
