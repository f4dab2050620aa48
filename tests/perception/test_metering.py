import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.geometry import camera_looking_along, pinhole_matrix
from perception.metering import blade_outline, meter_disc, meter_outline, meter_point
from perception.values import CameraPose

MATRIX = pinhole_matrix(500.0, 640, 480)
GREY = np.random.default_rng(0).integers(0, 256, (480, 640)).astype(np.uint8)


def brute_force(grey, x, y, r):
    rows, columns = np.mgrid[: grey.shape[0], : grey.shape[1]]
    return (columns - x) ** 2 + (rows - y) ** 2 <= r * r


@settings(deadline=None)
@given(x=st.floats(-40, 680), y=st.floats(-40, 520), r=st.floats(3, 60))
def test_the_disc_is_all_pixels_within_the_radius_and_the_picture(x, y, r):
    inside = brute_force(GREY, x, y, r)
    found = meter_disc(GREY, np.array([x, y]), r)
    if found is None:
        assert inside.sum() < 12
        return
    assert found.pixels == inside.sum()
    assert found.mean_grey == pytest.approx(GREY[inside].mean())


@pytest.mark.parametrize("centre", [None, np.array([np.nan, 3.0]), np.array([1e12, -1e12])])
def test_a_point_outside_or_behind_is_not_metered(centre):
    assert meter_disc(GREY, centre, 30.0) is None


def test_saturation_and_black_are_counted():
    grey = np.zeros((100, 100), np.uint8)
    grey[:, 50:] = 255
    found = meter_disc(grey, np.array([49.5, 50.0]), 20.0)
    assert found.clipped == pytest.approx(0.5, abs=0.02)
    assert found.black == pytest.approx(0.5, abs=0.02)


def looking(position, direction):
    return CameraPose(0.0, np.asarray(position, float), camera_looking_along(direction))


def test_the_disc_follows_the_inspection_point():
    camera = looking((0, -12, 50), (0, 1, 0))
    grey = np.full((480, 640), 40, np.uint8)
    grey[:240] = 200
    upper = meter_point(grey, np.array([0, 0, 53.0]), camera, MATRIX, 0.05)
    assert upper.mean_grey == 200
    assert meter_point(grey, np.array([0, -30.0, 50]), camera, MATRIX, 0.05) is None


def picture_of_blade(camera, root, tip, half_width):
    """White blade on a bright sky, drawn by casting each pixel's ray past the axis."""
    rows, columns = np.mgrid[:480, :640]
    rays = np.stack([(columns - 320) / 500, (rows - 240) / 500, np.ones((480, 640))], -1)
    rays = rays @ camera.rotation_wc.T
    axis = (tip - root) / np.linalg.norm(tip - root)
    normal = np.cross(rays, axis)
    distance = np.abs((root - camera.position_w) @ np.moveaxis(normal, -1, 0).reshape(3, -1))
    distance = distance.reshape(480, 640) / np.linalg.norm(normal, axis=-1)
    return np.where(distance < half_width, 90, 250).astype(np.uint8)


def test_the_blade_s_own_outline_leaves_the_sky_out():
    camera = looking((0.3, -12, 50), (0, 1, 0.02))
    root, tip = np.array([-20.0, 0, 40]), np.array([25.0, 1, 62])
    grey = picture_of_blade(camera, root, tip, 0.5)
    outline = blade_outline(root, tip, 0.4, camera, MATRIX)
    found = meter_outline(grey, outline)
    assert found.mean_grey == pytest.approx(90, abs=1)
    assert found.pixels > 5000
    near = meter_outline(grey, outline, np.array([320.0, 240.0]), 60.0)
    assert 1000 < near.pixels < found.pixels
    wide = blade_outline(root, tip, 1.5, camera, MATRIX)
    assert meter_outline(grey, wide).mean_grey > 120


def test_an_outline_behind_or_beside_the_picture_is_not_metered():
    camera = looking((0, -12, 50), (0, -1, 0))
    root, tip = np.array([-20.0, 0, 40]), np.array([25.0, 0, 62])
    assert meter_outline(GREY, blade_outline(root, tip, 0.4, camera, MATRIX)) is None
    aside = looking((0, -12, 50), (0, 1, 0))
    far = np.array([0, 0, 300.0])
    outline = blade_outline(root + far, tip + far, 0.4, aside, MATRIX)
    assert meter_outline(GREY, outline) is None
    assert meter_outline(GREY, outline, np.array([-500.0, 0.0]), 50.0) is None


def test_metering_is_fast():
    grey = np.zeros((1080, 1920), np.uint8)
    start = time.perf_counter()
    for _ in range(20):
        meter_disc(grey, np.array([960.0, 540.0]), 96.0)
    assert (time.perf_counter() - start) / 20 < 0.01
