import numpy as np

from drivers.simulated.mid360_pattern import RAYS_PER_S, rays


def elevations_deg(directions):
    return np.rad2deg(np.arcsin(directions[:, 2].astype(float)))


def test_rays_fill_360_by_minus_7_to_52_degrees():
    directions, _ = rays(12.0, 4 * RAYS_PER_S)
    elevation = elevations_deg(directions)
    assert -7.01 < elevation.min() < -6.5
    assert 50.5 < elevation.max() < 52.01
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    share, _ = np.histogram(azimuth, bins=36)
    assert share.min() > 0.9 * share.mean()
    share, _ = np.histogram(elevation, bins=np.arange(-6, 52, 4))
    assert share.min() > 0.5 * share.mean()


def test_directions_are_unit_vectors_at_200_000_a_second():
    directions, offsets_s = rays(3.0, 20_000)
    assert directions.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(offsets_s[[0, -1]], [0, 0.1 - 5e-6])


def test_the_pattern_does_not_depend_on_where_a_batch_is_cut():
    whole, _ = rays(7.0, 4000)
    parts = np.concatenate([rays(7.0, 1001)[0], rays(7.0 + 1001 / RAYS_PER_S, 2999)[0]])
    np.testing.assert_allclose(parts, whole, atol=2e-5)


def test_it_does_not_repeat_so_half_a_second_sees_more_than_five_times_a_tenth():
    def cells(directions):
        azimuth = np.rad2deg(np.arctan2(directions[:, 1], directions[:, 0]))
        cell = np.floor(azimuth / 0.5) * 1000 + np.floor(elevations_deg(directions) / 0.5)
        return len(np.unique(cell))

    tenth, second = cells(rays(0.0, 20_000)[0]), cells(rays(0.0, 200_000)[0])
    assert second > 3 * tenth


def test_after_ten_hours_the_rays_are_as_smooth_as_at_the_start():
    def step_rad(t0_s):
        line = rays(t0_s, 400)[0][::4].astype(float)
        return np.linalg.norm(np.diff(line, axis=0), axis=1)

    np.testing.assert_allclose(step_rad(36_000.0).std(), step_rad(0.0).std(), atol=2e-3)
