import asyncio
import time

import pytest

from config.settings import Settings
from drivers.bus import Key
from drivers.clock import MonotonicClock
from mission.flight.observation import RequestKind
from mission.processes.flight import Flight
from mission.processes.runtime import Runtime
from mission.remote.messages import Intent
from tests.mission.processes.test_flight_resume import HandBus


@pytest.fixture
def flight(tmp_path):
    return Flight(Runtime(Settings(), MonotonicClock(), tmp_path), HandBus())


async def rest(flight, for_s):
    begun_s = time.monotonic()
    await flight._rest_until(flight._clock.now_s() + for_s)
    return time.monotonic() - begun_s


async def test_a_rest_takes_its_time(flight):
    assert 0.2 <= await rest(flight, 0.2) < 5.0


async def test_whatever_is_asked_for_ends_a_rest(flight):
    asking = Intent(id="1", kind=RequestKind.ABORT)
    asyncio.get_running_loop().call_later(0.05, flight._bus.deliver, Key.INTENT, asking)
    assert await rest(flight, 30.0) < 10.0
    assert await rest(flight, 0.2) >= 0.2
