import numpy as np
import pytest

from perception.steady_poses import SteadyPoses
from perception.values import Pose

UPRIGHT = np.array([1.0, 0, 0, 0])
STEP_S = 0.05


def flown(seed=1, seconds=30.0, noise_m=0.3, velocity_noise_mps=0.08):
    """A receiver's jitter of 1.5 s on a vehicle that swings; true places (N, 3) and poses told."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, seconds, STEP_S)
    true = np.stack([np.sin(0.8 * times), 0.5 * np.cos(times), 0.1 * times], axis=1)
    speed = np.gradient(true, STEP_S, axis=0)
    decay = np.exp(-STEP_S / 1.5)
    jitter = np.zeros((len(times), 3))
    for k in range(1, len(times)):
        step = np.sqrt(1 - decay**2) * rng.normal(0.0, noise_m, 3)
        jitter[k] = decay * jitter[k - 1] + step
    told = [
        Pose(float(t), p + e, UPRIGHT, v + rng.normal(0.0, velocity_noise_mps, 3))
        for t, p, e, v in zip(times, true, jitter, speed, strict=True)
    ]
    return true, told


def blur_m(places, true, window_s=2.0):
    """Median over windows of how far the places of one window are spread about the true ones."""
    errors, count = places - true, round(window_s / STEP_S)
    starts = range(len(errors) // 3, len(errors) - count, count)
    return float(np.median([errors[a : a + count].std(axis=0).mean() for a in starts]))


def test_within_two_seconds_the_poses_hang_together():
    true, told = flown()
    steady, places = SteadyPoses(), []
    for pose in told:
        steady.follow([pose])
        places.append(steady.poses[-1].position_w)
    before = blur_m(np.stack([pose.position_w for pose in told]), true)
    after = blur_m(np.stack(places), true)
    assert before > 0.15
    assert after < 0.3 * before


def test_they_stay_where_the_autopilot_believes_to_be():
    true, told = flown(seconds=60.0)
    moved = [Pose(p.stamp_s, p.position_w + 1.5, UPRIGHT, p.velocity_w) for p in told]
    steady = SteadyPoses()
    steady.follow(moved)
    assert steady.poses[-1].position_w == pytest.approx(true[-1] + 1.5, abs=0.5)
    assert len(steady.poses) == 120


def test_a_pose_is_taken_once_in_whatever_pieces_they_come():
    _, told = flown(seconds=5.0)
    whole, parts = SteadyPoses(), SteadyPoses()
    whole.follow(told)
    for k in range(0, len(told), 7):
        parts.follow(told[max(0, k - 20) : k + 7])
    assert [p.stamp_s for p in whole.poses] == [p.stamp_s for p in parts.poses]
    assert whole.poses[-1].position_w == pytest.approx(parts.poses[-1].position_w)


@pytest.mark.parametrize(("gap_s", "step_m"), [(1.5, 0.0), (0.05, 8.0)])
def test_a_gap_or_a_step_of_the_frame_begins_anew(gap_s, step_m):
    _, told = flown(seconds=5.0)
    last = told[-1]
    after = Pose(last.stamp_s + gap_s, last.position_w + step_m, UPRIGHT, last.velocity_w)
    steady = SteadyPoses()
    steady.follow([*told, after])
    assert [pose.stamp_s for pose in steady.poses] == [after.stamp_s]
    assert steady.poses[-1].position_w == pytest.approx(after.position_w)
