"""The bench's scenes: repeatable, true to their own definitions, strangers to the estimators."""

import ast
import math
from pathlib import Path

import numpy as np
import pytest

import perception
from benchmarks.angle_scenes import SceneOptions, make_scene
from benchmarks.angle_sites import Site
from benchmarks.blade_family import DRAWN, draw_planform, published_models
from perception.rotor import angle_of


def test_the_same_seed_gives_the_same_scene():
    one, again = make_scene(3), make_scene(3)
    np.testing.assert_array_equal(one.points_w, again.points_w)
    assert one.stop_angle_deg == again.stop_angle_deg
    assert not np.array_equal(make_scene(4).points_w[:50], one.points_w[:50])


@pytest.mark.parametrize("seed", range(3))
def test_the_stop_angle_is_that_of_the_first_blade_from_the_tower(seed):
    scene = make_scene(seed)
    measured = angle_of(scene.directions_w[0], scene.normal_w, scene.tower_down_w)
    assert math.degrees(measured) % 120 == pytest.approx(scene.stop_angle_deg, abs=0.05)
    assert 0 <= scene.stop_angle_deg < 120


def test_families_are_published_planforms_and_freely_drawn_ones():
    rng = np.random.default_rng(1)
    plans = [draw_planform(rng) for _ in range(200)]
    assert {p.model for p in plans} == {*published_models(), DRAWN}
    assert all(24 < p.length_m < 66 for p in plans)
    prebend = np.array([p.prebend_m[-1] / p.radius_m for p in plans])
    assert prebend.min() < 0.005
    assert prebend.max() > 0.045
    assert 0.4 < np.mean([p.world_sections for p in plans]) < 0.6


def test_sites_leave_the_turbine_alone_and_change_what_is_behind_it():
    field = make_scene(5)
    ridge = make_scene(5, SceneOptions(site=Site.RIDGE))
    coast = make_scene(5, SceneOptions(site=Site.COAST))
    assert field.stop_angle_deg == ridge.stop_angle_deg == coast.stop_angle_deg
    assert len(ridge.points_w) > 1.05 * len(field.points_w)
    assert coast.points_w[:, 2].min() > 0.5


def test_pitch_follows_the_field_mix():
    rng_seeds = range(120)
    from benchmarks.angle_scenes import _draw_pitch  # the draw alone: scenes are slow to build

    pitches = np.array([_draw_pitch(np.random.default_rng(s), SceneOptions()) for s in rng_seeds])
    middle = np.median(pitches, axis=1)
    assert 0.28 < (middle < 6.5).mean() < 0.52
    assert 0.33 < (middle > 80.5).mean() < 0.57
    assert ((np.ptp(pitches, axis=1) > 80).mean()) < 0.15


def test_what_is_drawn_can_be_bounded_to_a_set_of_turbines():
    rng = np.random.default_rng(2)
    plans = [draw_planform(rng, ("v27", "nrel-5mw")) for _ in range(12)]
    assert {p.model for p in plans} == {"v27", "nrel-5mw"}


def test_no_constant_of_scenes_or_worlds_is_imported_by_perception():
    for path in Path(perception.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            for name in names:
                assert name.split(".")[0] not in {"benchmarks", "drivers", "mission"}, (path, name)
