"""What metering asks for reaches the camera between two ticks, along a blade only."""

import dataclasses

import pytest
from pydantic import TypeAdapter

from config.settings import Settings
from config.turbine import Site
from drivers.bus import Key, Sample
from drivers.clock import MonotonicClock
from mission.flight.command import Phase
from mission.flight.observation import ExposureState
from mission.processes.flight import IDLE_PROGRESS, Flight
from mission.processes.runtime import Runtime
from tests.mission.processes.test_flight_resume import HandBus, intent

METERED = ExposureState(1.0, 180.0, in_range=False, ev_wanted=-0.7)


class Camera:
    def __init__(self):
        self.wanted = []

    def want_ev(self, ev):
        self.wanted.append(ev)


@pytest.mark.parametrize(
    ("phase", "started", "wanted"),
    [(Phase.TRACK, True, [-0.7]), (Phase.HOLD, True, []), (Phase.TRACK, False, [])],
)
def test_an_exposure_is_ordered_as_it_comes_along_a_blade(tmp_path, phase, started, wanted):
    site = Site(name="t1", turbine="v27", tower_north_m=46.5)
    bus = HandBus()
    flight = Flight(Runtime(Settings(sites=(site,)), MonotonicClock(), tmp_path), bus)
    flight._payload = Camera()
    if started:
        bus.deliver(Key.INTENT, intent(1))
    flight._progress = dataclasses.replace(IDLE_PROGRESS, phase=phase)
    payload = TypeAdapter(ExposureState).dump_json(METERED)
    bus.takers[Key.EXPOSURE](Sample(Key.EXPOSURE, payload, None))
    assert flight._payload.wanted == wanted
    assert flight._inputs.exposure == METERED
