import math

import numpy as np
import pytest

from benchmarks.angle_scenes import AngleScene, SceneOptions, make_scene
from benchmarks.angle_sites import Site
from config.settings import Settings
from perception.estimator import rotor_estimator
from perception.geometry import stop_angle_difference_deg
from perception.rotor import Refusal, RefusalCode, Rotor, blade_angles_deg, direction_at
from perception.rotor_fit import fit_rotor
from perception.tower_reference import tower_reference


@pytest.fixture(scope="module")
def scene() -> AngleScene:
    return make_scene(7)


def _fit(scene: AngleScene, points=None, **changes) -> Rotor | Refusal:
    given = {
        "prior_hub_w": scene.prior_hub_w,
        "prior_normal_w": scene.prior_normal_w,
        "radius_m": scene.radius_m,
    }
    cloud = scene.points_w if points is None else points
    return fit_rotor(cloud, scene.viewpoint_w, **(given | changes))


def _of_blade(scene: AngleScene, k: int) -> np.ndarray:
    rel = scene.points_w - scene.hub_w
    flat = rel - np.outer(rel @ scene.normal_w, scene.normal_w)
    arms = [
        direction_at(math.radians(scene.stop_angle_deg + 120 * i), scene.normal_w, scene.down_w)
        for i in range(3)
    ]
    nearest = np.stack([flat @ arm for arm in arms], axis=1).argmax(axis=1)
    return (nearest == k) & (np.linalg.norm(flat, axis=1) > 2.0)


def _error(rotor: Rotor | Refusal, scene: AngleScene) -> float:
    assert isinstance(rotor, Rotor), rotor
    return abs(stop_angle_difference_deg(rotor.stop_angle_deg, scene.stop_angle_deg))


@pytest.mark.parametrize("seed", [101, 102, 103, 104, 105, 106])
def test_drawn_rotors_are_measured_within_a_degree(seed):
    drawn = make_scene(seed)
    rotor = _fit(drawn)
    assert _error(rotor, drawn) < 1.0
    off = rotor.hub_w - drawn.hub_w
    assert np.linalg.norm(off) < 0.6
    assert rotor.normal_w @ drawn.normal_w > math.cos(math.radians(1.5))


def test_a_known_shape_gives_the_pitch_of_each_blade(scene):
    rotor = _fit(scene, turbine=scene.turbine)
    assert _error(rotor, scene) < 0.6
    for blade, angle in zip(rotor.blades, blade_angles_deg(rotor.stop_angle_deg), strict=True):
        k = round((angle - scene.stop_angle_deg) / 120.0) % 3
        assert blade.pitch_deg == pytest.approx(scene.pitch_deg[k], abs=6.0)


@pytest.mark.parametrize("seed", [424, 428])
def test_a_blade_before_the_tower_is_not_measured_on_it(seed):
    drawn = make_scene(seed)
    rotor = _fit(drawn, turbine=drawn.turbine)
    for blade, angle in zip(rotor.blades, blade_angles_deg(rotor.stop_angle_deg), strict=True):
        k = round((angle - drawn.stop_angle_deg) / 120.0) % 3
        assert blade.pitch_deg == pytest.approx(drawn.pitch_deg[k], abs=6.0)


def test_blades_are_named_and_point_where_their_names_say(scene):
    rotor = _fit(scene)
    assert [b.name for b in rotor.blades] == ["A", "B", "C"]
    for blade, angle in zip(rotor.blades, blade_angles_deg(rotor.stop_angle_deg), strict=True):
        expected = direction_at(math.radians(angle), rotor.normal_w, scene.down_w)
        assert blade.direction_w @ expected > math.cos(math.radians(8))


def test_without_any_prior_the_tower_tells_the_side(scene):
    rotor = _fit(scene, prior_hub_w=None, prior_normal_w=None)
    assert _error(rotor, scene) < 1.0


def test_without_prior_axis_and_tower_the_side_is_unknown(scene):
    below = (scene.points_w - scene.hub_w) @ scene.normal_w > 0.03 * scene.radius_m + 0.3
    answer = _fit(scene, scene.points_w[~below], prior_normal_w=None)
    assert isinstance(answer, Refusal)
    assert answer.code is RefusalCode.SIDE_UNKNOWN


def test_dirty_points_change_nothing(scene):
    dirt = [np.full((300, 3), bad) for bad in (np.nan, np.inf, 0.0, 1e30)]
    rotor = _fit(scene, np.concatenate([scene.points_w, *dirt]))
    assert rotor.stop_angle_deg == pytest.approx(_fit(scene).stop_angle_deg, abs=1e-6)


@pytest.mark.parametrize("count", [0, 1, 20])
def test_too_few_points_are_refused(scene, count):
    answer = _fit(scene, scene.points_w[:count])
    assert isinstance(answer, Refusal)
    assert answer.code is RefusalCode.NO_POINTS


@pytest.mark.parametrize("k", [0, 1, 2])
def test_tower_and_two_blades_are_not_a_rotor(scene, k):
    answer = _fit(scene, scene.points_w[~_of_blade(scene, k)])
    assert isinstance(answer, Refusal)


def test_a_rotor_with_a_blade_that_was_not_found_is_refused():
    options = SceneOptions(models=("v27",), site=tuple(Site)[3])
    lost = make_scene(52252, options)
    answer = _fit(lost, prior_sigma_m=6.0)
    assert isinstance(answer, Refusal)
    assert answer.code is RefusalCode.NOT_CONVERGED


def test_two_million_points_are_thinned_first(scene):
    rng = np.random.default_rng(1)
    many = np.repeat(scene.points_w, 2_000_000 // len(scene.points_w), axis=0)
    rotor = _fit(scene, many + rng.normal(0, 0.01, many.shape))
    assert _error(rotor, scene) < 1.0


def test_random_clutter_and_walls_are_not_rotors(scene):
    rng = np.random.default_rng(2)
    noise = rng.uniform(-15, 15, (6000, 3)) + scene.hub_w
    assert isinstance(_fit(scene, noise), Refusal)
    across = np.cross(scene.normal_w, [0, 0, 1.0])
    wall = (
        scene.hub_w
        + rng.uniform(-20, 20, (6000, 1)) * across
        + rng.uniform(-12, 12, (6000, 1)) * np.array([0, 0, 1.0])
        + rng.normal(0, 0.05, (6000, 3))
    )
    assert isinstance(_fit(scene, wall), Refusal)


def test_hills_fog_and_a_second_turbine_behind_do_not_matter(scene):
    rng = np.random.default_rng(3)
    other = make_scene(11)
    behind = other.points_w - other.hub_w + scene.hub_w + 45 * scene.normal_w
    fog = scene.viewpoint_w + 4 * rng.normal(size=(3000, 3))
    rotor = _fit(scene, np.concatenate([scene.points_w, behind, fog]))
    assert _error(rotor, scene) < 1.0


def test_the_tower_is_a_better_reference_than_a_wrong_gravity(scene):
    tower = tower_reference(
        scene.points_w, scene.hub_w, scene.normal_w, scene.down_w, scene.radius_m
    )
    assert tower is not None
    assert tower.down_w @ scene.tower_down_w > math.cos(math.radians(1.5))
    assert math.degrees(tower.sigma_rad) < 0.6


def test_one_second_in_the_paper_s_window_is_still_enough():
    narrow = make_scene(12, SceneOptions(window_deg=60.0, seconds=2.0))
    answer = _fit(narrow)
    assert isinstance(answer, Refusal) or _error(answer, narrow) < 3.0


@pytest.mark.parametrize("method", ["rotor_fit", "fermat"])
def test_the_factory_gives_either_method(scene, method):
    settings = Settings.model_validate({"estimation": {"method": method}})
    estimator = rotor_estimator(settings, scene.turbine)
    answer = estimator.update(
        scene.points_w,
        scene.origins_w,
        3.5,
        prior_hub_w=scene.prior_hub_w,
        prior_normal_w=scene.prior_normal_w,
    )
    assert isinstance(answer, Rotor | Refusal)
    if isinstance(answer, Rotor):
        assert answer.stamp_s == 3.5
        assert answer.method == method
