import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.rotor_plane import fit_rotor_plane


@settings(deadline=None, max_examples=30)
@given(
    yaw=st.floats(-3.1, 3.1), tilt=st.floats(0, 0.15), outliers=st.integers(0, 600),
    seed=st.integers(0, 99),
)  # fmt: skip
def test_the_normal_is_found_among_outliers_and_points_away_from_the_drone(
    yaw, tilt, outliers, seed
):
    rng = np.random.default_rng(seed)
    normal = np.array(
        [math.cos(tilt) * math.cos(yaw), math.cos(tilt) * math.sin(yaw), -math.sin(tilt)]
    )
    across = np.cross(normal, [0, 0, 1.0])
    across /= np.linalg.norm(across)
    up = np.cross(across, normal)
    spread = rng.uniform(-12, 12, (1500, 2))
    points = spread[:, :1] * across + spread[:, 1:] * up + rng.normal(0, 0.1, (1500, 1)) * normal
    clutter = rng.uniform(-15, 15, (outliers, 3))
    plane = fit_rotor_plane(np.concatenate([points, clutter]), -20 * normal, threshold_m=0.5)
    assert plane.normal_w @ normal > math.cos(math.radians(3))
    assert abs((plane.point_w - 0) @ normal) < 0.3


def test_ground_is_no_rotor_plane():
    rng = np.random.default_rng(0)
    ground = rng.uniform((-20, -20, -0.1), (20, 20, 0.1), (2000, 3))
    found = fit_rotor_plane(ground, np.array([0, 0, 30.0]), threshold_m=0.3)
    assert found is None or abs(found.normal_w[2]) < math.sin(math.radians(20))


def test_too_few_points_are_no_plane():
    assert fit_rotor_plane(np.zeros((0, 3)), np.zeros(3), threshold_m=0.5) is None
    assert fit_rotor_plane(np.zeros((100, 3)), np.zeros(3), threshold_m=0.5) is None
