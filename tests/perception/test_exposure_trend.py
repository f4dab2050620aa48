"""Ramps of the light, and what only looks like one."""

import math

import pytest

from perception.exposure_automatic import Automatic
from perception.exposure_trend import Trend


def ramp(ev_per_s, frames=20):
    trend = Trend()
    for k in range(frames):
        trend.update(0.1 * k, 0.1 * k * ev_per_s)
    return trend


@pytest.mark.parametrize("ev_per_s", [1.0, -2.0])
def test_a_ramp_is_known_by_its_rate(ev_per_s):
    assert ramp(ev_per_s).rate() == pytest.approx(ev_per_s)


@pytest.mark.parametrize(("doubt", "left"), [(0.5, 0.5), (0.9, 0.1), (2.0, 0.0)])
def test_what_may_be_something_else_s_is_no_part_of_a_ramp(doubt, left):
    for sign in (1.0, -1.0):
        assert ramp(sign).rate(doubt) == pytest.approx(sign * left)
        assert abs(ramp(sign).ahead(0.2, doubt)) < abs(ramp(sign).ahead(0.2))


def test_the_automatic_s_pace_is_the_way_it_has_left_by_its_rate():
    automatic = Automatic(present=True)
    for k in range(10):
        automatic.update(1.0, 0.1 * k)
    assert automatic.pace() == pytest.approx(0.0)
    automatic.update(3.0, 1.0)
    assert automatic.pace() == pytest.approx(-2.0 * automatic.rate, rel=0.05)
    later = automatic.ahead(0.01)
    assert automatic.pace() * 0.01 == pytest.approx(later, rel=0.05)
    assert math.isclose(Automatic(present=False).pace(), 0.0)
