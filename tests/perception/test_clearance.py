import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.clearance import Followed, OccupancyMemory, RepeatedScans

ORIGIN = np.zeros(3)


def wall(seed=0, count=4000, x=20.0):
    rng = np.random.default_rng(seed)
    points = rng.uniform((x, -15, -15), (x, 15, 15), (count, 3))
    points[:, 0] += rng.normal(0, 0.02, count)
    return points


def test_the_nearest_point_of_the_live_scan_is_found():
    memory = OccupancyMemory()
    memory.update(wall(), 1.0, ORIGIN)
    distance, place = memory.nearest(np.array([5.0, 0, 0]))
    assert distance == pytest.approx(15.0, abs=0.2)
    assert place[0] == pytest.approx(20.0, abs=0.1)


def test_nothing_seen_is_nothing_near():
    memory = OccupancyMemory()
    assert memory.nearest(ORIGIN) is None
    memory.update(np.empty((0, 3)), 1.0, ORIGIN)
    assert memory.nearest(ORIGIN) is None
    assert memory.around(ORIGIN, 50.0, 100).shape == (0, 3)


def test_a_single_stray_return_does_not_count_but_one_seen_twice_does():
    memory = OccupancyMemory()
    stray = np.array([[10.0, 3.0, 2.0]])
    memory.update(np.concatenate([wall(), stray]), 1.0, ORIGIN)
    assert memory.nearest(ORIGIN)[0] > 19
    memory.update(np.concatenate([wall(1), stray]), 1.1, ORIGIN)
    assert memory.nearest(ORIGIN)[0] == pytest.approx(np.linalg.norm(stray), abs=1e-3)


def test_strays_far_apart_in_time_never_add_up():
    memory = OccupancyMemory()
    for scan in range(40):
        stray = [[10.0, 3.0, 2.0]] if scan % 5 == 0 else np.empty((0, 3))
        memory.update(np.concatenate([wall(scan), stray]), 0.1 * scan, ORIGIN)
        assert memory.nearest(ORIGIN)[0] > 19
    assert len(memory.around(np.array([10.0, 3, 2]), 3.0)) == 0


def test_two_returns_in_neighbouring_voxels_count_at_once():
    memory = OccupancyMemory()
    memory.update(np.array([[10.0, 3.1, 2.0], [10.0, 3.6, 2.0]]), 1.0, ORIGIN)
    assert memory.nearest(ORIGIN)[0] == pytest.approx(10.63, abs=0.05)


def test_backscatter_before_the_sensor_is_ignored():
    memory = OccupancyMemory(ignore_within_m=1.5)
    fog = np.random.default_rng(3).normal(0, 0.4, (500, 3))
    memory.update(np.concatenate([fog, wall()]), 1.0, ORIGIN)
    assert memory.nearest(ORIGIN)[0] > 1.4


def test_what_has_left_the_view_is_remembered():
    memory = OccupancyMemory()
    memory.update(wall(), 1.0, ORIGIN)
    memory.update(wall(1, x=-30.0), 9.0, ORIGIN)
    around = memory.around(np.array([15.0, 0, 0]), 12.0, 5000)
    assert around.dtype == np.float32
    assert len(around) > 500
    np.testing.assert_allclose(around[:, 0], 20.0, atol=0.1)
    assert len(memory.around(np.array([15.0, 0, 0]), 12.0, 5000, not_before_s=5.0)) == 0


@settings(deadline=None, max_examples=30)
@given(limit=st.integers(2, 400), radius=st.floats(6, 60))
def test_thinning_keeps_the_nearest_and_the_limit(limit, radius):
    memory = OccupancyMemory()
    memory.update(wall(), 1.0, ORIGIN)
    here = np.array([15.0, 2.0, 1.0])
    whole = memory.around(here, radius, 100_000)
    thin = memory.around(here, radius, limit)
    assert len(thin) == min(limit, len(whole))
    assert np.all(np.linalg.norm(thin - here, axis=1) <= radius + 1e-3)
    assert nearest(thin, here) == pytest.approx(nearest(whole, here))


def nearest(points, here):
    return np.linalg.norm(points - here, axis=1).min()


def test_points_that_cannot_be_do_no_harm():
    memory = OccupancyMemory()
    bad = np.array([[np.nan, 0, 0], [np.inf, 1, 2], [1e30, 0, 0], [0, -np.inf, 0]])
    memory.update(np.repeat(bad, 3, axis=0), 1.0, ORIGIN)
    memory.update(np.repeat(bad, 3, axis=0), 1.1)
    assert memory.nearest(ORIGIN) is None


def test_memory_grows_with_what_is_seen_and_not_with_time():
    memory = OccupancyMemory()
    for scan in range(60):
        memory.update(wall(scan % 7), 0.1 * scan, ORIGIN)
    assert memory.voxels < 61 * 61 * 2
    for step in range(20):
        memory.update(wall(step, count=20_000, x=30.0 + 2 * step), 10.0 + step, ORIGIN)
    assert memory.voxels > 40_000


def test_a_scan_is_taken_in_fast():
    rng = np.random.default_rng(5)
    memory = OccupancyMemory()
    took = []
    for scan in range(12):
        ground = rng.uniform((-60, -60, -40), (60, 60, -39.8), (20_000, 3))
        start = time.perf_counter()
        memory.update(ground, 0.1 * scan, ORIGIN)
        memory.nearest(ORIGIN)
        memory.around(ORIGIN, 30.0)
        took.append(time.perf_counter() - start)
    assert min(took[2:]) < 0.05


def test_the_same_scan_again_and_again_is_noticed_within_a_second():
    watch = RepeatedScans()
    fresh = [wall(seed).astype(np.float32) for seed in range(6)]
    assert not any(watch.update(points) for points in fresh)
    assert any(watch.update(fresh[-1]) for _ in range(5))
    assert not watch.update(wall(99).astype(np.float32))


def test_a_loop_of_old_scans_is_noticed():
    watch = RepeatedScans()
    loop = [wall(seed).astype(np.float32) for seed in range(3)]
    assert any(watch.update(points) for points in loop * 3)


def test_one_doubled_scan_or_empty_ones_are_no_alarm():
    watch = RepeatedScans()
    one = wall(1).astype(np.float32)
    assert not any([watch.update(one), watch.update(one), watch.update(wall(2).astype(np.float32))])
    assert not any(watch.update(np.empty((0, 3), np.float32)) for _ in range(20))


def test_where_a_followed_blade_lay_earlier_nothing_is_left():
    memory = OccupancyMemory()
    blade = np.array([[10.0, 0.0, 0.1 * k] for k in range(100)])
    pole = blade + np.array([0.0, 12.0, 0.0])
    memory.update(np.concatenate([blade, pole]), 1.0, ORIGIN)
    memory.update(blade + np.array([2.0, 0.0, 0.0]), 4.0, ORIGIN)
    root, tip = np.array([11.0, 0.0, 0.0]), np.array([11.0, 0.0, 30.0])
    found = memory.around(ORIGIN, 40.0, followed=Followed(root, tip, 4.0, 3.0))
    assert set(np.round(found[np.abs(found[:, 1]) < 1, 0], 0)) == {12.0}
    assert (found[:, 1] > 11).any()
    everything = memory.around(ORIGIN, 40.0)
    assert {10.0, 12.0} <= set(np.round(everything[:, 0], 0))
