import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from config.sensors import Lidar
from perception.deskew import points_in_world
from perception.geometry import (
    lidar_in_body,
    quaternion_from_rotation,
    rotation_from_euler,
    rotation_from_quaternion,
)
from perception.values import Pose, Scan

LIDAR = Lidar()


def pose_at(t, *, velocity=(0.0, 0.0, 0.0), yaw_rate=0.0, start=(0.0, 0.0, 0.0)):
    rotation = rotation_from_euler(0.02, -0.03, yaw_rate * t)
    position = np.asarray(start) + np.asarray(velocity) * t
    return Pose(t, position, quaternion_from_rotation(rotation), np.asarray(velocity, float))


def scan_of(points_w, ages, stamp, pose_of):
    """What the sensor would have delivered of fixed world points."""
    rows = []
    for point, age in zip(points_w, ages, strict=True):
        pose = pose_of(stamp - age)
        rotation = rotation_from_quat(pose)
        sensor = pose.position_w + rotation @ np.array(LIDAR.offset_m)
        rows.append((rotation @ lidar_in_body(LIDAR.nose_down_deg)).T @ (point - sensor))
    points_l = np.array(rows, np.float32)
    zeros = np.zeros(len(rows), np.uint8)
    return Scan(stamp, 1, points_l, np.asarray(ages, np.float32), zeros, zeros)


def rotation_from_quat(pose):

    return rotation_from_quaternion(pose.quaternion_wb)


@given(
    speed=st.floats(-3, 3),
    yaw_rate=st.floats(-1, 1),
    stamp=st.floats(1.0, 50.0),
    seed=st.integers(0, 1000),
)
def test_a_fixed_point_stays_fixed_however_the_vehicle_moves_and_turns(
    speed, yaw_rate, stamp, seed
):
    rng = np.random.default_rng(seed)
    ages = rng.uniform(0, 0.1, 30)

    def pose_of(t):
        return pose_at(t, velocity=(speed, 0.5, -speed), yaw_rate=yaw_rate)

    ways = rng.normal(0, 1, (30, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    points_w = pose_of(stamp).position_w + ways * rng.uniform(3, 69, (30, 1))
    poses = [pose_of(stamp - 0.14 + 0.02 * k) for k in range(9)]
    found, origins = points_in_world(scan_of(points_w, ages, stamp, pose_of), poses, LIDAR)
    reach = np.linalg.norm(points_w - origins, axis=1)
    assert np.all(np.linalg.norm(found - points_w, axis=1) < 0.005 + 2e-3 * reach)


def test_a_scan_newer_than_the_newest_pose_is_carried_on_by_the_velocity():
    def pose_of(t):
        return pose_at(t, velocity=(2.0, 0.0, 0.0))

    points_w = np.array([[30.0, 0.0, 5.0]])
    found, _ = points_in_world(scan_of(points_w, [0.0], 5.0, pose_of), [pose_of(4.9)], LIDAR)
    np.testing.assert_allclose(found, points_w, atol=0.01)


def test_points_that_cannot_be_are_left_out():
    nan, inf = math.nan, math.inf
    points = [[nan, 0, 0], [inf, 0, 0], [0, 0, 0], [1e30, 0, 0], [500, 0, 0], [20, 0, 0]]
    ages = np.array([0, 0, 0, 0, 0, 0], np.float32)
    tags = np.zeros(6, np.uint8)
    scan = Scan(1.0, 1, np.array(points, np.float32), ages, tags, tags)
    found, origins = points_in_world(scan, [pose_at(1.0)], LIDAR)
    assert found.shape == origins.shape == (1, 3)


def test_returns_that_the_sensor_doubts_can_be_left_out():
    tags = np.array([0, 4], np.uint8)
    scan = Scan(
        1.0, 1, np.full((2, 3), 9, np.float32), np.zeros(2, np.float32), np.zeros(2, np.uint8), tags
    )
    assert len(points_in_world(scan, [pose_at(1.0)], LIDAR)[0]) == 2
    assert len(points_in_world(scan, [pose_at(1.0)], LIDAR, trusted_only=True)[0]) == 1


@pytest.mark.parametrize("poses", [[], [pose_at(1.0)]])
def test_no_points_or_no_pose_give_nothing(poses):
    empty = np.zeros(0, np.uint8)
    scan = Scan(1.0, 1, np.zeros((0, 3), np.float32), np.zeros(0, np.float32), empty, empty)
    assert points_in_world(scan, poses, LIDAR)[0].shape == (0, 3)


def test_a_whole_scan_is_placed_fast():
    rng = np.random.default_rng(1)
    n = 20_000
    tags = np.zeros(n, np.uint8)
    scan = Scan(
        5.0,
        1,
        rng.normal(0, 20, (n, 3)).astype(np.float32),
        rng.uniform(0, 0.1, n).astype(np.float32),
        tags,
        tags,
    )
    poses = [pose_at(4.8 + 0.02 * k) for k in range(11)]
    best = min(timed(lambda: points_in_world(scan, poses, LIDAR)) for _ in range(5))
    assert best < 0.03


def timed(call):
    start = time.perf_counter()
    call()
    return time.perf_counter() - start
