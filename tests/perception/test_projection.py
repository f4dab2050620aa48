import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.geometry import camera_looking_along, pinhole_matrix
from perception.projection import project, project_all
from perception.values import CameraPose

MATRIX = pinhole_matrix(500.0, 640, 480)


def camera(direction, position=(0.0, 0.0, 80.0)):
    return CameraPose(0.0, np.asarray(position, float), camera_looking_along(direction))


@given(
    x=st.floats(-1, 1), y=st.floats(-1, 1), elevation=st.floats(-0.5, 0.5), depth=st.floats(1, 50)
)
def test_the_projected_point_lies_on_its_own_ray(x, y, elevation, depth):
    view = camera((x, y + 2.0, elevation))
    ray_c = np.array([0.3 * x, 0.4 * y, 1.0])
    point = view.position_w + view.rotation_wc @ (ray_c * depth)
    np.testing.assert_allclose(
        project(point, view, MATRIX), [320 + 500 * ray_c[0], 240 + 500 * ray_c[1]], atol=1e-6
    )


def test_the_optical_axis_meets_the_middle_and_up_is_up():
    view = camera((0, 1, 0))
    assert project(np.array([0, 12.0, 80]), view, MATRIX) == pytest.approx([320, 240])
    assert project(np.array([0, 12.0, 81]), view, MATRIX)[1] < 240
    assert project(np.array([1, 12.0, 80]), view, MATRIX)[0] > 320


@pytest.mark.parametrize("point", [(0, -5, 80), (0, 0, 80), (0, np.nan, 80), (0, np.inf, 80)])
def test_behind_the_camera_and_nowhere_there_is_no_pixel(point):
    assert project(np.array(point, float), camera((0, 1, 0)), MATRIX) is None


def test_many_points_are_projected_like_one():
    view = camera((1, 1, 0.2))
    points = np.random.default_rng(0).normal(0, 20, (50, 3)) + np.array([0, 0, 80])
    pixels, ahead = project_all(points, view, MATRIX)
    for point, pixel, is_ahead in zip(points, pixels, ahead, strict=True):
        one = project(point, view, MATRIX)
        assert (one is not None) == is_ahead
        if one is not None:
            np.testing.assert_allclose(one, pixel)
