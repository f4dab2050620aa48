import math
from random import Random

import numpy as np
import pytest

from drivers.simulated.position_error import EstimatorError

STILL = (0.0, 0.0, 0.0)


def wander(profile, seconds, seed=1, prepare=None):
    error = EstimatorError(profile, Random(seed))
    if prepare:
        prepare(error)
    rows = []
    for _ in range(int(seconds / 0.1)):
        error.step(0.1, STILL, STILL)
        rows.append(error.position)
    return error, np.array(rows)


@pytest.mark.parametrize(("profile", "sigma"), [("rtk", 0.2), ("gnss", 1.5)])
def test_the_position_wanders_as_its_profile_says(profile, sigma):
    _, rows = wander(profile, 4000)
    assert rows.std(axis=0).mean() == pytest.approx(sigma, rel=0.35)


def test_attitude_is_off_by_about_half_a_degree():
    error = EstimatorError("rtk", Random(5))
    rolls = []
    for _ in range(20000):
        error.step(0.1, STILL, STILL)
        rolls.append(error.roll)
    assert math.degrees(np.std(rolls)) == pytest.approx(0.5, rel=0.35)


def test_a_wrong_gps_jumps_eight_metres_within_a_second_and_comes_back():
    error, before = wander("rtk", 10, prepare=None)
    error.fault("gps", "wrong", STILL)
    for _ in range(11):
        error.step(0.1, STILL, STILL)
    assert error.position[0] - before[-1][0] == pytest.approx(8.0, abs=0.5)
    error.fault("gps", "ok", STILL)
    for _ in range(300):
        error.step(0.1, STILL, STILL)
    assert abs(error.position[0]) < 2.0


def test_gps_back_after_a_loss_resets_the_frame():
    error, _ = wander("rtk", 1)
    error.fault("gps", "off", STILL)
    for _ in range(50):
        error.step(0.1, STILL, STILL)
    assert not error.position_ok
    assert error.position[0] > 2.0
    error.fault("gps", "ok", STILL)
    error.step(0.1, STILL, STILL)
    assert error.position_ok
    assert error.reset_count == 1
    assert abs(error.position[0]) < 1.0


def test_a_wrong_compass_turns_the_heading_by_fifteen_degrees():
    error, _ = wander("rtk", 1)
    straight = error.yaw
    error.fault("compass", "wrong", STILL)
    for _ in range(30):
        error.step(0.1, STILL, STILL)
    assert math.degrees(error.yaw - straight) == pytest.approx(15.0, abs=1.5)


def test_a_stuck_barometer_keeps_its_height():
    error, _ = wander("rtk", 1)
    error.fault("baro", "stuck", (0.0, 0.0, 50.0))
    for _ in range(100):
        error.step(0.1, (0.0, 0.0, 60.0), STILL)
    assert 60.0 + error.position[2] == pytest.approx(50.0, abs=1.0)
