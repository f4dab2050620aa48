import random

import pytest

from drivers.stamps import MinimumOffset


def test_a_late_message_keeps_the_time_at_which_it_was_made() -> None:
    offset = MinimumOffset()
    assert offset.map(10.0, 110.02) == pytest.approx(110.02)
    assert offset.map(10.1, 110.92) == pytest.approx(110.12)


def test_a_stamp_is_never_later_than_its_arrival() -> None:
    chance, offset = random.Random(1), MinimumOffset(window_s=2.0)
    for step in range(2000):
        made_s = step * 0.02
        arrival_s = made_s + 50.0 + chance.expovariate(20.0)
        assert offset.map(made_s, arrival_s) <= arrival_s + 1e-9


def test_the_least_delay_of_the_window_is_found_among_jitter() -> None:
    chance, offset = random.Random(2), MinimumOffset(window_s=5.0)
    stamps = []
    for step in range(500):
        made_s = step * 0.02
        arrival_s = made_s + 50.004 + chance.expovariate(30.0)
        stamps.append(offset.map(made_s, arrival_s) - made_s)
    assert stamps[-1] == pytest.approx(50.004, abs=0.005)


def test_a_drift_between_the_clocks_is_followed() -> None:
    offset = MinimumOffset(window_s=5.0)
    for step in range(6000):
        made_s = step * 0.02
        arrival_s = made_s * 1.0005 + 0.01
        stamp_s = offset.map(made_s, arrival_s)
    assert arrival_s - stamp_s < 0.005


def test_a_device_that_restarts_is_measured_anew() -> None:
    offset = MinimumOffset()
    offset.map(1000.0, 5.0)
    assert offset.map(0.5, 8.0) == pytest.approx(8.0)
