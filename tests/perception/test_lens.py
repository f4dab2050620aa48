import numpy as np
import pytest

from config.sensors import Camera
from perception.lens import lens_of

BENT = Camera(distortion=(-0.12, 0.06, 0.001, -0.002, 0.01), principal_point_px=(2600.0, 1930.0))


def test_a_lens_of_a_smaller_picture_is_the_same_lens():
    full, quarter = lens_of(BENT, 5184, 3888), lens_of(BENT, 1296, 972)
    ray = np.array([[0.1, -0.07, 1.0]])
    np.testing.assert_allclose(full.pixels(ray)[0] / 4, quarter.pixels(ray)[0])
    assert quarter.focal_px == pytest.approx(20.0 / 7.6 * 1296)


@pytest.mark.parametrize("camera", [Camera(), BENT])
def test_a_pixel_comes_back_from_its_own_ray(camera):
    lens = lens_of(camera, 1296, 972)
    x, y = np.meshgrid(np.linspace(0, 1296, 9), np.linspace(0, 972, 7))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    rays = lens.rays(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    back, ahead = lens.pixels(12.0 * rays)
    assert ahead.all()
    np.testing.assert_allclose(back, pixels, atol=1e-6)


def test_barrel_distortion_draws_the_corners_inward():
    straight, bent = (
        lens_of(Camera(), 1296, 972),
        lens_of(Camera(distortion=(-0.1, 0, 0, 0, 0)), 1296, 972),
    )
    corner = straight.rays(np.array([[1296.0, 972.0]]))
    assert (bent.pixels(corner)[0] < [1296.0, 972.0]).all()


def test_what_lies_behind_is_not_ahead():
    lens = lens_of(Camera(), 1296, 972)
    _, ahead = lens.pixels(np.array([[0.0, 0.0, -1.0], [50.0, 0.0, 1.0], [0.0, 0.0, 5.0]]))
    assert ahead.tolist() == [False, False, True]
