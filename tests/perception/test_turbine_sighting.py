"""The whole turbine, seen by the bench's thin LiDAR from places along a blade."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.tracking_flight import caster_of
from benchmarks.tracking_lidar import BodyPose, ThinLidar
from benchmarks.tracking_senses import true_blades
from benchmarks.tracking_trials import draw_trial
from drivers.simulated.rotor_frame import blade_names, rotor_frame
from mission.flight.rotor_model import MeasuredBlade, rotor_model
from perception.geometry import rotation_from_euler
from perception.turbine_sighting import near_turbine, sight_turbine

DRIFT = np.array([0.8, -0.9, 0.7])


@pytest.fixture(scope="module")
def world():
    """A caster of a true turbine of 54 m blades, its blades, and what was measured of it."""
    trial = draw_trial(301, 5)
    frame, names = rotor_frame(trial.scene), blade_names(trial.scene.stop_angle_deg)
    blades = [
        MeasuredBlade(name, tuple(blade.axis_w), pitch)
        for name, blade, pitch in zip(names, frame.blades, trial.scene.pitch_deg, strict=True)
    ]
    solid = rotor_model(frame.hub_w, frame.normal_w, blades, trial.turbine).solid()
    return trial, caster_of(trial), true_blades(trial), solid


def look(world, name, share, *, seed=1, heading_deg=0.0):
    """Return a second's returns and the believed place, 12 m upwind of a blade at a share of it."""
    trial, caster, blades, solid = world
    blade, length = blades[name], trial.turbine.blade_length_m
    upwind = -rotor_frame(trial.scene).normal_w
    beside = blade.at(share * length)
    place = beside + 12.0 * upwind
    turn = rotation_from_euler(0.0, 0.0, float(np.arctan2(-upwind[1], -upwind[0])))
    wrong = rotation_from_euler(0.0, 0.0, np.deg2rad(heading_deg))
    lidar = ThinLidar(caster, trial.settings.lidar, seed)
    others = tuple(
        (one.centres_w[0], one.centres_w[-1]) for one in blades.values() if one.name != name
    )
    tower = (np.zeros(3), np.array([0.0, 0.0, trial.turbine.tower_height_m]))
    true, believed = BodyPose(place, turn), BodyPose(place + DRIFT, wrong @ turn)
    scans = [
        lidar.scan(true, believed, (beside, blade.frame.axis_w), (*others, tower))
        for _ in range(10)
    ]
    return np.concatenate(scans), believed.position, blade.frame.axis_w, solid


@pytest.mark.parametrize(("name", "share"), [("A", 0.1), ("C", 0.2), ("C", 0.4)])
def test_all_of_a_drift_is_seen_where_other_parts_are_in_view(world, name, share):
    points, place, axis, solid = look(world, name, share, heading_deg=1.0)
    sighting = sight_turbine(points, place, solid, DRIFT + np.array([0.4, 0.3, -0.4]))
    assert sighting is not None
    error = sighting.offset_w - DRIFT
    assert abs(error @ axis) < 0.5
    assert np.linalg.norm(error) < 0.8
    assert np.sqrt(axis @ sighting.covariance[:3, :3] @ axis) < 0.6
    told = np.append(error, sighting.heading_rad - np.deg2rad(1.0))
    assert told @ np.linalg.solve(sighting.covariance, told) < 14.0


def test_where_one_blade_alone_is_seen_the_drift_along_it_is_left_unsure(world):
    points, place, axis, solid = look(world, "B", 0.5)
    index = int(np.argmax([blade.axis_w @ axis for blade in solid.blades]))
    root, length = solid.blades[index].root_w + DRIFT, solid.blades[index].length_m
    relative = points - root
    along = relative @ axis
    off = np.linalg.norm(relative - along[:, None] * axis, axis=1)
    alone = points[(off < 4.0) & (along > 0.2 * length)]
    sighting = sight_turbine(alone, place, solid, DRIFT)
    assert sighting is not None
    assert np.sqrt(axis @ sighting.covariance[:3, :3] @ axis) > 2.0
    view = -rotor_frame(world[0].scene).normal_w
    assert np.sqrt(view @ sighting.covariance[:3, :3] @ view) < 0.5


def test_the_end_of_a_blade_tells_of_the_drift_along_it(world):
    points, place, axis, solid = look(world, "B", 0.96)
    sighting = sight_turbine(points, place, solid, DRIFT + 0.3)
    assert sighting is not None
    assert abs((sighting.offset_w - DRIFT) @ axis) < 0.8
    assert np.sqrt(axis @ sighting.covariance[:3, :3] @ axis) < 0.8


def test_nothing_seen_is_no_sighting(world):
    points, place, _, solid = look(world, "B", 0.5)
    assert sight_turbine(points[:0], place, solid, DRIFT) is None
    far = replace(solid, tower_top_w=solid.tower_top_w + 500.0, blades=())
    assert sight_turbine(points, place, far, DRIFT) is None


def test_the_ground_is_not_near_the_turbine(world):
    _, _, _, solid = look(world, "B", 0.5)
    ground = np.array([[30.0, 20.0, 0.5], [0.0, 3.0, 1.0]])
    hub = solid.hub_w[None] + [0.0, 0.0, 10.0]
    assert near_turbine(np.concatenate([ground, hub]), solid).tolist() == [False, False, True]
