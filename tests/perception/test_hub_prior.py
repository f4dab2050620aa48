import math

import numpy as np
import pytest

from perception.hub_prior import TowerSurvey


def survey(turbine, relative_deg, *, known=True, distance_m=52.0, error_m=8.0, top_m=None):
    bearing = math.radians(turbine.upwind_deg + relative_deg)
    place = distance_m * np.array([math.cos(bearing), math.sin(bearing)])
    expected = np.array([error_m * math.cos(relative_deg), error_m * math.sin(relative_deg), 1.0])
    found = TowerSurvey(expected_w=expected, turbine=turbine.turbine if known else None)
    top = turbine.turbine.hub_height_m + 6 if top_m is None else top_m
    for k, z in enumerate(np.arange(6.0, top, 4.0)):
        points, _ = turbine.scan([*place, z], 0.8, seed=k, pose_noise_m=0.1)
        found.update(points, float(k))
    return found


def yaw_error_deg(result, turbine):
    upwind = -result.normal_w
    angle = math.degrees(math.atan2(upwind[1], upwind[0])) - turbine.upwind_deg
    return (angle + 180) % 360 - 180


@pytest.mark.parametrize("relative", [0, 90, 200])
@pytest.mark.parametrize(("stop", "pitch"), [(0.0, 85.0), (30.0, 3.0)])
def test_the_rotor_s_side_is_never_taken_for_the_other(synthetic_turbine, relative, stop, pitch):
    turbine = synthetic_turbine(
        stop_angle_deg=stop, pitch_deg=pitch, upwind_deg=17.0 + relative, seed=relative
    )
    result = survey(turbine, relative).result()
    if result.normal_w is None:
        # Allowed: unknown. Not allowed from where the blades are in full view.
        assert relative in (90, 180, 200, 270)
        return
    assert abs(yaw_error_deg(result, turbine)) < 8
    assert np.linalg.norm(result.hub_w - turbine.hub_w) < 3 * result.sigma_m
    assert np.linalg.norm(result.hub_w - turbine.hub_w) < 3.0


def test_an_unknown_type_still_gives_tower_and_side(synthetic_turbine):
    turbine = synthetic_turbine(stop_angle_deg=60)
    result = survey(turbine, 20, known=False).result()
    assert abs(yaw_error_deg(result, turbine)) < 8
    assert np.linalg.norm(result.hub_w - turbine.hub_w) < 4


def test_before_the_rotor_is_seen_its_side_is_unknown_and_sigma_large(synthetic_turbine):
    turbine = synthetic_turbine("iea-3.4-130", 1.0, stop_angle_deg=60)
    result = survey(turbine, 0, top_m=12.0).result()
    assert result.normal_w is None
    assert result.sigma_m > turbine.turbine.overhang_m
    assert np.hypot(*result.hub_w[:2]) < 1.0


def test_nothing_gathered_is_no_result(synthetic_turbine):
    found = TowerSurvey(expected_w=np.zeros(3), turbine=synthetic_turbine().turbine)
    assert found.result() is None
    found.update(np.full((5, 3), np.nan), 1.0)
    assert found.result() is None


def test_memory_is_bounded_whatever_is_seen(synthetic_turbine):
    rng = np.random.default_rng(0)
    found = TowerSurvey(expected_w=np.zeros(3), turbine=synthetic_turbine().turbine)
    for k in range(30):
        found.update(rng.uniform((-60, -60, 0), (60, 60, 120), (20_000, 3)), float(k))
    assert found._count <= len(found._key) == 1 << 17


def test_a_blade_that_points_up_is_not_taken_for_the_tower_seen_before(synthetic_turbine):
    turbine = synthetic_turbine("iea-3.4-130", 1.0, stop_angle_deg=60)
    found = survey(turbine, 0, error_m=2.0)
    before = found.result().tower
    # Two minutes later, before the rotor: all that is seen is a thin upright thing beside the hub.
    height = turbine.turbine.hub_height_m
    rng = np.random.default_rng(4)
    for k in range(30):
        angle, z = rng.uniform(0, 2 * np.pi, 400), rng.uniform(height - 12, height + 14, 400)
        ring = np.stack([9.0 + 1.2 * np.cos(angle), 6.0 + 1.2 * np.sin(angle), z], axis=1)
        found.update(ring, 400.0 + k)
    after = found.result().tower
    assert np.hypot(*(after.at_height(height) - before.at_height(height))[:2]) < 4.0
