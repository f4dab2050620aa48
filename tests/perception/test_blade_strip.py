import numpy as np
import pytest

from perception.blade_strip import Strip, StripFollower, find_strip
from perception.geometry import camera_looking_along, pinhole_matrix
from perception.values import CameraPose

WIDTH, HEIGHT = 640, 480
MATRIX = pinhole_matrix(1680.0, WIDTH, HEIGHT)
CAMERA = CameraPose(0.0, np.array([20.0, -12.0, 0.0]), camera_looking_along([0.0, 1.0, 0.0]))
AXIS_W = np.array([1.0, 0.0, 0.0])
PX_PER_M = 1680.0 / 12.0


def picture(middle_m, width_m, blade=150, ground=80, seed=1):
    """A blade that lies across the picture, ``middle_m`` above the middle row."""
    rows = (np.arange(HEIGHT) - HEIGHT / 2) / PX_PER_M
    inside = np.abs(rows + middle_m) < width_m / 2
    grey = np.where(inside[:, None], blade, ground) * np.ones((1, WIDTH))
    noise = np.random.default_rng(seed).normal(0, 4, grey.shape)
    return np.clip(grey + noise, 0, 255).astype(np.uint8)


def find(grey, expected_m=0.0, sigma_m=0.7, width_m=None):
    near_w = np.array([20.0, 0.0, expected_m])
    return find_strip(
        grey, near_w, AXIS_W, CAMERA, MATRIX, chord_m=1.6, thickness_m=0.4, sigma_m=sigma_m,
        width_m=width_m,
    )  # fmt: skip


@pytest.mark.parametrize(("blade", "ground"), [(150, 80), (80, 150), (250, 215)])
@pytest.mark.parametrize("middle_m", [-0.9, 0.0, 0.6])
def test_the_middle_of_the_blade_is_found_brighter_or_darker_than_what_is_behind(
    blade, ground, middle_m
):
    strip = find(picture(middle_m, 1.1, blade, ground))
    assert strip is not None
    assert strip.aside_w[2] * strip.middle_m == pytest.approx(middle_m, abs=0.05)
    assert strip.width_m == pytest.approx(1.1, abs=0.06)


def test_a_picture_without_edges_shows_no_blade():
    assert find(picture(0.0, 1.1, 100, 100)) is None


def test_one_edge_alone_is_not_believed():
    grey = picture(0.0, 1.1)
    grey[: HEIGHT // 2] = grey[HEIGHT // 2 : HEIGHT // 2 + 1]
    assert find(grey) is None


def test_what_is_far_aside_is_another_blade():
    assert find(picture(1.4, 0.6), sigma_m=0.3) is None


def test_what_is_much_wider_than_the_chord_is_a_tower():
    assert find(picture(0.0, 2.6)) is None


def test_the_edge_of_a_shadow_on_the_blade_is_not_its_own_where_its_width_is_known():
    lit, shaded = (picture(0.0, 1.4, blade, ground=140) for blade in (155, 90))
    grey = np.concatenate([lit[: HEIGHT // 2], shaded[HEIGHT // 2 :]])
    deceived, right = find(grey), find(grey, width_m=1.4)
    assert deceived is not None
    assert deceived.width_m < 0.8
    assert right is not None
    assert right.width_m == pytest.approx(1.4, abs=0.06)


def test_one_mistaken_edge_does_not_move_the_metering():
    follower = StripFollower()
    for k, middle in enumerate((0.1, 0.1, 0.8)):
        place = follower.update(_strip(middle), 0.1 * k)
    assert place == pytest.approx((0.1, 1.0))


def test_a_place_stays_while_the_expected_axis_jumps():
    follower = StripFollower()
    follower.update(_strip(0.5), 0.0, expected_m=0.0)
    assert follower.update(None, 0.1, expected_m=0.4) == pytest.approx((0.1, 1.0))


def test_what_was_not_seen_for_a_second_is_forgotten():
    follower = StripFollower()
    follower.update(_strip(0.5), 0.0)
    assert follower.update(None, 0.9) is not None
    assert follower.update(None, 1.1) is None


def _strip(middle_m):
    return Strip(middle_m, 1.0, np.array([0.0, 0.0, 1.0]), 5.0)
