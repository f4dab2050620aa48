import numpy as np
import pytest

from perception.frame_check import FrameCheck

RNG = np.random.default_rng(2)
SCENE = RNG.uniform(40, 200, (240, 320))


def frame(noise=1.0):
    return np.clip(SCENE + RNG.normal(0, noise, SCENE.shape), 0, 255).astype(np.uint8)


def test_noisy_frames_of_a_scene_that_stands_still_are_usable():
    check = FrameCheck()
    assert all(check.usable(frame(), 0.1 * k, 0.1 * k + 0.05) for k in range(20))


def test_a_frozen_stream_is_not_used_and_one_that_moves_again_is():
    check = FrameCheck()
    still = frame()
    used = [check.usable(still, 0.1 * k, 0.1 * k) for k in range(10)]
    assert used[:2] == [True, True]
    assert not any(used[2:])
    assert check.usable(frame(), 1.1, 1.1)


@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_blank_picture_is_not_used_until_it_stays(level):
    check = FrameCheck()
    blank = np.full((240, 320), level, np.uint8)
    used = [check.usable(blank, 0.1 * k, 0.1 * k) for k in range(25)]
    assert not any(used[:10])
    assert all(used[11:])


def test_a_frame_two_seconds_late_is_not_used():
    assert not FrameCheck().usable(frame(), 10.0, 12.0)


def test_another_size_is_no_crash():
    check = FrameCheck()
    assert check.usable(frame(), 0.0, 0.0)
    assert check.usable(frame()[:100, :100], 0.1, 0.1)
