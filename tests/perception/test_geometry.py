import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from perception.geometry import (
    quaternion_from_euler,
    rotation_from_euler,
    rotation_from_quaternion,
)

angles = st.floats(-3.1, 3.1)


@given(angles, angles, angles)
def test_the_quaternion_of_roll_pitch_and_yaw_is_their_rotation(
    roll: float, pitch: float, yaw: float
) -> None:
    found = rotation_from_quaternion(quaternion_from_euler(roll, pitch, yaw))
    np.testing.assert_allclose(found, rotation_from_euler(roll, pitch, yaw), atol=1e-9)
