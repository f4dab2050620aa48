"""The skeleton between coarse search and fit, and the parts of the fit that stand alone."""

import math

import numpy as np
import pytest

from benchmarks.angle_scenes import SceneOptions, make_scene
from perception.coarse_rotor import CoarseRotor
from perception.geometry import stop_angle_difference_deg
from perception.rotor import Rotor, direction_at
from perception.rotor_fit import fit_rotor
from perception.rotor_skeleton import straighten

DOWN = np.array([0.0, 0.0, -1.0])


def _tipped(normal, by_deg):
    axis = np.cross(normal, [0.0, 0.0, 1.0])
    turned = normal * math.cos(math.radians(by_deg)) + np.cross(axis, normal) * math.sin(
        math.radians(by_deg)
    )
    return turned / np.linalg.norm(turned)


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_plane_ten_degrees_off_is_put_right(seed):
    scene = make_scene(seed)
    off = CoarseRotor(
        scene.hub_w + 0.8,
        _tipped(scene.normal_w, 10.0),
        math.radians(scene.stop_angle_deg + 3.0),
        1.0,
        (20.0, 20.0, 20.0),
    )
    straight, cone = straighten(scene.points_w, off, DOWN, scene.radius_m, scene.prior_normal_w)
    assert straight.normal_w @ scene.normal_w > math.cos(math.radians(2.5))
    error = stop_angle_difference_deg(math.degrees(straight.angle_rad), scene.stop_angle_deg)
    assert abs(error) < 4.5
    assert math.radians(-3.0) < cone < math.radians(8.0)


@pytest.mark.parametrize("seed", [2, 3, 6])
def test_a_blade_a_quarter_turn_from_the_others_is_told(seed):
    scene = make_scene(seed, SceneOptions(feather_one=1.0, pitch_deg=(0.0, 5.0)))
    rotor = fit_rotor(
        scene.points_w,
        scene.viewpoint_w,
        prior_hub_w=scene.prior_hub_w,
        prior_normal_w=scene.prior_normal_w,
        radius_m=scene.radius_m,
    )
    assert isinstance(rotor, Rotor)
    for blade in rotor.blades:
        k = int(np.argmax(scene.directions_w @ blade.direction_w))
        if blade.pitch_deg is not None:
            assert abs(blade.pitch_deg - scene.pitch_deg[k]) < 25.0


def test_blades_point_along_their_own_bearings():
    scene = make_scene(8)
    rotor = fit_rotor(
        scene.points_w,
        scene.viewpoint_w,
        prior_hub_w=scene.prior_hub_w,
        prior_normal_w=scene.prior_normal_w,
        radius_m=scene.radius_m,
    )
    assert isinstance(rotor, Rotor)
    for blade in rotor.blades:
        assert (scene.directions_w @ blade.direction_w).max() > math.cos(math.radians(3.0))
    first = direction_at(math.radians(scene.stop_angle_deg), scene.normal_w, scene.tower_down_w)
    assert (scene.directions_w @ first).max() > math.cos(math.radians(7.0))
