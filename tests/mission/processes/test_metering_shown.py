import numpy as np
import pytest

from mission.processes.metering_shown import metering_shown

SIZE = (640, 360)


def test_a_disc_is_told_in_shares_of_the_width():
    shown = metering_shown(1.0, SIZE, np.array([320.0, 180.0]), 32.0, None)
    assert shown.centre == pytest.approx((0.5, 0.28125), abs=1e-3)
    assert (shown.radius, shown.aspect, shown.outline) == (0.05, 0.5625, ())


def test_an_outline_of_many_corners_keeps_its_shape_with_few():
    angle = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    outline = np.stack([320 + 64 * np.cos(angle), 180 + 64 * np.sin(angle)], axis=1)
    shown = metering_shown(1.0, SIZE, np.array([320.0, 180.0]), 128.0, outline)
    assert len(shown.outline) <= 30
    x, y = np.array(shown.outline).T * 640
    assert np.hypot(x - 320, y - 180) == pytest.approx(64, abs=0.1)


def test_an_outline_far_beyond_the_picture_stays_within_bounds():
    outline = np.array([[-1e9, 0.0], [1e9, 0.0], [0.0, 1e9]])
    shown = metering_shown(1.0, SIZE, np.array([0.0, 0.0]), 10.0, outline)
    assert np.abs(np.array(shown.outline)).max() <= 2


@pytest.mark.parametrize("centre", [None, np.array([np.nan, 1.0])])
def test_what_lies_behind_the_camera_is_not_shown(centre):
    assert metering_shown(1.0, SIZE, centre, 10.0, None) is None
