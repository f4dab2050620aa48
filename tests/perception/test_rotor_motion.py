import numpy as np
import pytest

from perception.rotor_motion import RotorMotionWatch
from perception.tower import Tower


def watch(
    turbine, rate_dps, relative_deg, *, distance_m=35.0, seconds=4.0, pose_noise_m=0.03,
    wander_w=0.0,
):  # fmt: skip
    bearing = np.radians(turbine.upwind_deg + relative_deg)
    place = np.array([distance_m * np.cos(bearing), distance_m * np.sin(bearing), 50.0])
    t = turbine.turbine
    tower = Tower(
        np.zeros(3), np.array([0.0, 0, 1]), t.tower_base_diameter_m / 2,
        (t.tower_top_diameter_m - t.tower_base_diameter_m) / 2 / t.tower_height_m,
        t.tower_height_m, t.tower_height_m, 0.1, 1000,
    )  # fmt: skip
    hub = turbine.hub_w + np.array([0.5, -0.4, 0.5])
    motion = RotorMotionWatch(hub, turbine.normal_w, t.rotor_radius_m, tower)
    found, noticed_s = None, None
    for k in range(int(seconds * 5)):
        time_s = 0.2 * k
        points, _ = turbine.scan(
            place, 0.2, seed=k, turn_deg=rate_dps * time_s, pose_noise_m=pose_noise_m
        )
        motion.update(points + wander_w * time_s, time_s)
        found = motion.result()
        if found is not None and found.turning and noticed_s is None:
            noticed_s = time_s
    return found, noticed_s


@pytest.mark.parametrize("relative", [0])
@pytest.mark.parametrize("rate", [12.0, -12.0, 0.5])
def test_a_turning_rotor_is_noticed_within_three_seconds(synthetic_turbine, rate, relative):
    turbine = synthetic_turbine(stop_angle_deg=40, trees=False, spacing_m=0.2)
    found, noticed_s = watch(turbine, rate, relative)
    assert noticed_s is not None
    assert noticed_s <= 3.0
    assert found.rate_dps == pytest.approx(rate, rel=0.15, abs=0.15)


@pytest.mark.parametrize("relative", [0, 85, 170])
def test_a_still_rotor_is_not_accused(synthetic_turbine, relative):
    turbine = synthetic_turbine(stop_angle_deg=10, trees=False, spacing_m=0.2)
    found, noticed_s = watch(turbine, 0.0, relative, seconds=6.0)
    assert noticed_s is None
    assert abs(found.rate_dps) < 0.25


def test_a_position_that_wanders_aside_is_at_most_a_slow_turn(synthetic_turbine):
    turbine = synthetic_turbine(stop_angle_deg=60, pitch_deg=82, trees=False, spacing_m=0.2)
    aside = np.cross(turbine.normal_w, [0.0, 0.0, 1.0])
    found, _ = watch(turbine, 0.0, 0, distance_m=50.0, wander_w=-0.17 * aside)
    assert abs(found.rate_dps) < 0.29


def test_without_points_nothing_is_known():
    motion = RotorMotionWatch(np.zeros(3), np.array([0.0, 1, 0]), 30.0)
    assert motion.result() is None
    for k in range(30):
        motion.update(np.empty((0, 3)), 0.2 * k)
    assert motion.result() is None


def test_over_a_gap_in_the_scans_nothing_is_told(synthetic_turbine):
    turbine = synthetic_turbine(stop_angle_deg=40, trees=False, spacing_m=0.2)
    bearing = np.radians(turbine.upwind_deg)
    place = np.array([35.0 * np.cos(bearing), 35.0 * np.sin(bearing), 50.0])
    motion = RotorMotionWatch(turbine.hub_w, turbine.normal_w, turbine.turbine.rotor_radius_m)
    # The position has slid while no scan came: the blades seem turned on.
    early, late = ([0.2 * k for k in range(7)], [4.2 + 0.2 * k for k in range(7)])
    for k, time_s in enumerate([*early, *late]):
        points, _ = turbine.scan(place, 0.2, seed=k, turn_deg=3.0 * (time_s > 4.0))
        motion.update(points, time_s)
        found = motion.result()
        assert found is None or not found.turning


def test_a_scan_that_was_overtaken_changes_nothing(synthetic_turbine):
    turbine = synthetic_turbine(stop_angle_deg=40, trees=False, spacing_m=0.2)
    bearing = np.radians(turbine.upwind_deg)
    place = np.array([35.0 * np.cos(bearing), 35.0 * np.sin(bearing), 50.0])
    once, twice = (
        RotorMotionWatch(turbine.hub_w, turbine.normal_w, turbine.turbine.rotor_radius_m)
        for _ in range(2)
    )
    for k in range(15):
        points, _ = turbine.scan(place, 0.2, seed=k)
        once.update(points, 0.2 * k)
        twice.update(points, 0.2 * k)
        old, _ = turbine.scan(place, 0.2, seed=k, turn_deg=-4.0)
        twice.update(old, 0.2 * k - 0.8)
    assert once.result() is not None
    assert once.result() == twice.result()
