import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.frames import (
    pitch_up_of,
    swap_attitude,
    swap_enu_ned,
    swap_yaw,
    yaw_of,
)
from perception.geometry import quaternion_from_euler, rotation_from_quaternion

NED_FROM_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD_FROM_FLU = np.diag([1.0, -1.0, -1.0])
numbers = st.floats(-1e3, 1e3)
angles = st.floats(-math.pi, math.pi)


def test_east_north_up_becomes_north_east_down() -> None:
    assert swap_enu_ned((1.0, 2.0, 3.0)) == (2.0, 1.0, -3.0)


@given(numbers, numbers, numbers)
def test_swapping_twice_gives_the_vector_back(x: float, y: float, z: float) -> None:
    assert swap_enu_ned(swap_enu_ned((x, y, z))) == (x, y, z)


@pytest.mark.parametrize(("enu_deg", "ned_deg"), [(0, 90), (90, 0), (180, -90), (-90, 180)])
def test_yaw_east_is_heading_ninety(enu_deg: float, ned_deg: float) -> None:
    assert math.degrees(swap_yaw(math.radians(enu_deg))) == pytest.approx(ned_deg)


@given(angles, angles, angles)
def test_an_attitude_is_the_rotation_between_the_swapped_frames(
    roll: float, pitch: float, yaw: float
) -> None:
    ned = quaternion_from_euler(roll, pitch, yaw)
    expected = NED_FROM_ENU.T @ rotation_from_quaternion(ned) @ FRD_FROM_FLU
    np.testing.assert_allclose(rotation_from_quaternion(swap_attitude(ned)), expected, atol=1e-9)


@given(st.floats(-1.5, 1.5), angles)
def test_heading_and_pitch_of_a_gimbal_survive_the_swap(pitch: float, yaw: float) -> None:
    enu = swap_attitude(quaternion_from_euler(0.0, pitch, yaw))
    assert pitch_up_of(enu) == pytest.approx(pitch, abs=1e-6)
    assert math.cos(yaw_of(enu) - swap_yaw(yaw)) == pytest.approx(1.0, abs=1e-6)
