import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.fermat_point import DegenerateTriangleError, ObtuseTriangleError, fermat_hub


def points_on_three_blades(stop_angle_rad, radii_m, hub_w, tilt_rad=0.0):
    angles = stop_angle_rad + np.deg2rad([0, 120, 240])
    in_plane = (
        np.stack([np.sin(angles), np.zeros(3), -np.cos(angles)], axis=1)
        * np.asarray(radii_m)[:, None]
    )
    c, s = np.cos(tilt_rad), np.sin(tilt_rad)
    return in_plane @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]]) + hub_w


@given(
    stop_angle=st.floats(0, 2 * np.pi / 3),
    radii=st.tuples(*[st.floats(6, 12)] * 3),
    tilt=st.floats(0, np.deg2rad(8)),
)
def test_the_hub_is_found_wherever_the_ring_cuts_each_blade(stop_angle, radii, tilt):
    hub_w = np.array([3.0, -40.0, 90.0])
    hub = fermat_hub(points_on_three_blades(stop_angle, radii, hub_w, tilt))
    np.testing.assert_allclose(hub.centre_w, hub_w, atol=1e-9)


def test_every_pair_of_blades_is_120_degrees_apart():
    directions = fermat_hub(points_on_three_blades(0.4, (7, 9, 11), np.zeros(3))).blade_directions_w
    np.testing.assert_allclose(directions @ directions.T, 1.5 * np.eye(3) - 0.5, atol=1e-9)


def test_collinear_points_are_no_rotor():
    with pytest.raises(DegenerateTriangleError):
        fermat_hub(np.array([[0.0, 0, 0], [0, 0, 5], [0, 0, 10]]))


def test_an_obtuse_triangle_is_no_rotor():
    with pytest.raises(ObtuseTriangleError, match="interior angle"):
        fermat_hub(np.array([[0.0, 0, 0], [10, 0, 1], [-10, 0, 1]]))
