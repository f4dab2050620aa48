import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.simulated.ned import (
    Home,
    enu_quaternion,
    euler,
    ned_quaternion,
    rates_b,
    swapped,
    turned,
)
from perception.geometry import quaternion_from_euler, rotation_from_quaternion

angles = st.floats(-1.4, 1.4)
NED_FROM_ENU = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
FLU_FROM_FRD = np.diag([1.0, -1, -1])


@given(roll=angles, pitch=angles, yaw=st.floats(-3.1, 3.1))
def test_attitude_turns_between_the_frames_and_back(roll, pitch, yaw):
    flu = quaternion_from_euler(roll, pitch, yaw)
    frd = ned_quaternion(flu)
    expected = NED_FROM_ENU @ rotation_from_quaternion(flu) @ FLU_FROM_FRD
    np.testing.assert_allclose(rotation_from_quaternion(frd), expected, atol=1e-9)
    back = rotation_from_quaternion(enu_quaternion(frd))
    np.testing.assert_allclose(back, rotation_from_quaternion(flu), atol=1e-9)
    np.testing.assert_allclose(euler(flu), (roll, pitch, yaw), atol=1e-6)


def test_looking_east_is_heading_ninety():
    assert turned(0.0) == pytest.approx(math.pi / 2)
    assert euler(ned_quaternion((1.0, 0.0, 0.0, 0.0)))[2] == pytest.approx(math.pi / 2)
    assert swapped((1.0, 2.0, 3.0)) == (2.0, 1.0, -3.0)


def test_a_turn_to_the_left_is_a_positive_rate_about_up():
    rate = rates_b(quaternion_from_euler(0, 0, 0.1), quaternion_from_euler(0, 0, 0.12), 0.02)
    np.testing.assert_allclose(rate, (0, 0, 1.0), atol=1e-4)


def test_a_hundred_metres_north_is_a_thousandth_of_a_degree():
    latitude, longitude, altitude = Home(54.0, 6.0, 20.0).geodetic((0.0, 111.3, 5.0))
    assert latitude - 54.0 == pytest.approx(0.001, rel=0.01)
    assert longitude == 6.0
    assert altitude == 25.0
