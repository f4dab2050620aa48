from types import SimpleNamespace

import pytest

from mission.flight.events import Event
from mission.flight.observation import ExposureState, Observation
from mission.flight.watch import Watch

TICK_S = 0.05


@pytest.fixture
def told_after():
    """How long after the last metered picture it is told; None: not within ten seconds."""

    def look(on_leg):
        watch = Watch()
        exposure = ExposureState(0.0, 130.0, True, 0.0)
        for tick in range(1, 200):
            now_s = tick * TICK_S
            seen = Observation(now_s, tick, exposure=exposure)
            flight = SimpleNamespace(
                observation=seen, now_s=now_s, on_leg=on_leg(now_s), raised=set()
            )
            if Event.EXPOSURE_STALE in watch._camera(flight, seen):
                return now_s
        return None

    return look


def test_along_a_blade_pictures_that_tell_nothing_are_told_soon(told_after):
    assert told_after(lambda _: True) == pytest.approx(2.5, abs=0.15)


def test_between_two_passes_there_is_no_blade_to_be_seen(told_after):
    assert told_after(lambda _: False) is None


def test_a_pass_that_begins_has_time_for_its_first_picture(told_after):
    assert told_after(lambda now_s: now_s > 6.0) == pytest.approx(8.0, abs=0.15)
