import math

import numpy as np
import pytest

from perception.tower import fit_tower


def climb(turbine, bearing_deg, distance_m, top_m, **scan):
    bearing = math.radians(bearing_deg)
    place = distance_m * np.array([math.cos(bearing), math.sin(bearing)])
    heights = np.arange(6.0, top_m, 4.0)
    scans = [
        turbine.scan([*place, z], 0.8, seed=k, pose_noise_m=0.1, **scan)[0]
        for k, z in enumerate(heights)
    ]
    return thin(np.concatenate(scans))


def thin(points, voxel_m=0.35):
    keys = np.floor(points / voxel_m).astype(int)
    return points[np.unique(keys, axis=0, return_index=True)[1]]


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(("bearing", "stop"), [(90, 0), (275, 119.95)])
def test_axis_radius_and_top_are_found_fifteen_metres_off(synthetic_turbine, bearing, stop, known):
    turbine = synthetic_turbine(stop_angle_deg=stop, seed=bearing)
    height = turbine.turbine.tower_height_m
    points = climb(turbine, bearing, 52.0, height + 8)
    offset = 15.0 * np.array([math.cos(bearing), math.sin(bearing)])
    tower = fit_tower(points, expected_xy=offset, turbine=turbine.turbine if known else None)
    assert np.hypot(*tower.at_height(height)[:2]) < 0.4
    assert tower.top_m == pytest.approx(height, abs=1.5)
    radius = turbine.turbine.tower_top_diameter_m / 2
    assert tower.radius_m + tower.taper * (height - tower.foot_w[2]) == pytest.approx(
        radius, abs=0.35
    )
    assert math.degrees(math.acos(tower.axis_w[2])) < 0.5


def test_a_top_that_was_not_seen_is_not_claimed(synthetic_turbine):
    turbine = synthetic_turbine(stop_angle_deg=60)
    points = climb(turbine, 0, 50.0, 10.0)
    tower = fit_tower(points[points[:, 2] < 30], expected_xy=np.zeros(2), turbine=turbine.turbine)
    assert tower.top_m is None
    assert tower.highest_m < 31


def test_trees_and_hills_are_no_tower(synthetic_turbine):
    turbine = synthetic_turbine()
    points = climb(turbine, 90, 50.0, 40.0)
    off = points[np.linalg.norm(points[:, :2], axis=1) > 8]
    low = off[off[:, 2] < 14]
    assert fit_tower(low, expected_xy=np.array([20.0, 30.0]), turbine=turbine.turbine) is None


@pytest.mark.parametrize("count", [0, 1, 20])
def test_too_few_points_are_no_tower(count):
    assert fit_tower(np.zeros((count, 3)), expected_xy=np.zeros(2)) is None


def test_points_that_cannot_be_do_no_harm(synthetic_turbine):
    turbine = synthetic_turbine()
    points = climb(turbine, 90, 50.0, 60.0)
    bad = np.array([[np.nan, 0, 0], [np.inf, 0, 1], [1e30, 0, 2]])
    tower = fit_tower(np.concatenate([points, bad]), expected_xy=np.zeros(2))
    assert np.hypot(*tower.at_height(40.0)[:2]) < 0.4


def test_the_distance_from_the_skin_is_signed(synthetic_turbine):
    turbine = synthetic_turbine()
    tower = fit_tower(climb(turbine, 90, 50.0, 60.0), expected_xy=np.zeros(2))
    centre = tower.at_height(30.0)
    distances = tower.surface_distance(centre + np.array([[0, 0, 0], [5.0, 0, 0]]))
    assert distances[0] < -0.5
    assert distances[1] == pytest.approx(5.0 + distances[0], abs=1e-6)
