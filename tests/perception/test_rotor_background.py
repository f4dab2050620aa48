import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.angle_scenes import AngleScene, SceneOptions, make_scene
from benchmarks.angle_sites import Site
from perception.geometry import stop_angle_difference_deg
from perception.rotor import Refusal, Rotor, right_in_plane
from perception.rotor_background import without_background
from perception.rotor_fit import fit_rotor


@pytest.fixture(scope="module")
def scene() -> AngleScene:
    return make_scene(7)


def _slope(scene: AngleScene, behind_m: float) -> np.ndarray:
    """A hillside of 75 deg behind a rotor, its surface rough."""
    rng = np.random.default_rng(1)
    right = right_in_plane(scene.normal_w, scene.down_w)
    up, lean = -scene.down_w, math.tan(math.radians(15.0))
    a, b = rng.uniform(-50, 50, 20_000), rng.uniform(-25, 50, 20_000)
    away = behind_m + lean * b + 0.5 * np.sin(a / 5.0) + rng.normal(0, 0.2, len(a))
    level = scene.normal_w - (scene.normal_w @ up) * up
    return scene.hub_w + np.outer(a, right) + np.outer(b, up) + np.outer(away, level)


def _background_left(scene: AngleScene, cloud: np.ndarray) -> np.ndarray:
    return without_background(cloud, scene.viewpoint_w, scene.prior_normal_w, scene.down_w)


def test_a_hillside_is_taken_out_and_the_rotor_is_left(scene):
    slope = _slope(scene, 22.0)
    near = np.linalg.norm(scene.points_w - scene.hub_w, axis=1) < scene.radius_m
    rotor = scene.points_w[near]
    left = _background_left(scene, np.concatenate([rotor, slope]))
    behind = (left - scene.hub_w) @ scene.normal_w > 12.0
    assert behind.sum() < 0.05 * len(slope)
    assert (~behind).sum() > 0.99 * len(rotor)


def test_a_hillside_with_tower_and_two_blades_before_it_is_no_rotor(scene):
    arm = scene.directions_w[0]
    rel = scene.points_w - scene.hub_w
    along = rel @ arm
    beside = np.linalg.norm(rel - np.outer(along, arm), axis=1)
    two = scene.points_w[~((along > 2.0) & (beside < 5.0))]
    cloud = np.concatenate([two, _slope(scene, 26.0)])
    answer = fit_rotor(
        cloud, scene.viewpoint_w, prior_hub_w=scene.hub_w, prior_normal_w=scene.prior_normal_w,
        radius_m=scene.radius_m, prior_sigma_m=18.0,
    )  # fmt: skip
    assert isinstance(answer, Refusal)


def test_a_ridge_of_the_bench_does_not_hide_a_rotor():
    options = replace(SceneOptions(), site=Site.RIDGE, models=("nrel-1.79-100",))
    drawn = make_scene(74011, replace(options, prior_error_m=(0.0, 15.0)))
    answer = fit_rotor(
        drawn.points_w, drawn.origins_w, prior_hub_w=drawn.prior_hub_w,
        prior_normal_w=drawn.prior_normal_w, radius_m=drawn.radius_m, prior_sigma_m=18.0,
    )  # fmt: skip
    assert isinstance(answer, Rotor), answer
    assert abs(stop_angle_difference_deg(answer.stop_angle_deg, drawn.stop_angle_deg)) < 1.0
