from __future__ import annotations

import math

import numpy as np

from config.sensors import Lidar
from drivers.simulated.link import TruthState
from drivers.simulated.mesh import Part
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.rotor_frame import rotor_frame
from drivers.simulated.scanner import RawScan, Scanner
from drivers.simulated.scene import Scene
from drivers.simulated.truth_history import TruthHistory
from perception.geometry import (
    lidar_in_body,
    quaternion_from_rotation,
    rotation_from_euler,
    rotation_from_quaternion,
)


def state(t_s: float, position: np.ndarray, quaternion: np.ndarray) -> TruthState:
    x, y, z = (float(v) for v in position)
    w, i, j, k = (float(v) for v in quaternion)
    return TruthState(t_s, (x, y, z), (0, 0, 0), (w, i, j, k), (0, 0, 0), (1, 0, 0, 0), 0.0)


def scan_from(caster: Raycaster, scene: Scene, *, moving: bool, fog: float = 0.0) -> RawScan:
    frame = rotor_frame(scene)
    yaw = math.atan2(frame.normal_w[1], frame.normal_w[0])
    quaternion = quaternion_from_rotation(rotation_from_euler(0.0, 0.0, yaw))
    history = TruthHistory()
    for k in range(11):
        aside = np.array([0.0, 0.0, -40.0 * 0.02 * k if moving else 0.0])
        eye = frame.hub_w - 18.0 * frame.normal_w + aside
        history.add(state(0.02 * k, eye, quaternion))
    return Scanner(caster, history, Lidar(), 1, fog).scan(0.0, 0.2)


def in_world(scan: RawScan, position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    lidar = Lidar()
    body = scan.points_l @ lidar_in_body(lidar.nose_down_deg).T + np.asarray(lidar.offset_m)
    return np.asarray(body @ rotation_from_quaternion(quaternion).T + position)


def test_the_turbine_is_measured_where_it_stands(caster: Raycaster, scene: Scene) -> None:
    frame = rotor_frame(scene)
    scan = scan_from(caster, scene, moving=False)
    yaw = math.atan2(frame.normal_w[1], frame.normal_w[0])
    quaternion = quaternion_from_rotation(rotation_from_euler(0.0, 0.0, yaw))
    points = in_world(scan, frame.hub_w - 18.0 * frame.normal_w, quaternion)
    trusted = scan.returned & (scan.tag == 0) & (scan.part <= Part.HUB)
    assert trusted.sum() > 300
    distance = caster.clearance_m(points[trusted].astype(np.float32), 0.0)
    # A few mixed returns between surfaces are not marked by the firmware.
    assert np.quantile(distance, 0.9) < 0.06
    assert np.median(distance) < 0.02


def test_each_ray_leaves_from_where_the_sensor_was(caster: Raycaster, scene: Scene) -> None:
    frame = rotor_frame(scene)
    scan = scan_from(caster, scene, moving=True)
    yaw = math.atan2(frame.normal_w[1], frame.normal_w[0])
    quaternion = quaternion_from_rotation(rotation_from_euler(0.0, 0.0, yaw))
    eye = frame.hub_w - 18.0 * frame.normal_w
    moved = in_world(scan, eye, quaternion) + np.outer(scan.offsets_s, [0.0, 0.0, -40.0])
    trusted = scan.returned & (scan.tag == 0) & (scan.part <= Part.TOWER)
    assert trusted.sum() > 100
    assert np.median(caster.clearance_m(moved[trusted].astype(np.float32), 0.0)) < 0.03


def test_nose_down_it_looks_from_30_below_to_29_above_ahead(
    caster: Raycaster, scene: Scene
) -> None:
    scan = scan_from(caster, scene, moving=False, fog=0.15)  # fog returns come from anywhere
    ways = scan.points_l[scan.returned] @ lidar_in_body(Lidar().nose_down_deg).T
    ways = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    ahead = np.hypot(ways[:, 1], 0.0) < 0.1
    elevation = np.degrees(np.arcsin(ways[ahead & (ways[:, 0] > 0), 2]))
    assert -32.0 < elevation.min() < -25.0
    assert 25.0 < elevation.max() < 31.0


def test_fog_takes_returns_and_gives_near_ones(caster: Raycaster, scene: Scene) -> None:
    clear = scan_from(caster, scene, moving=False)
    foggy = scan_from(caster, scene, moving=False, fog=0.1)
    far = np.linalg.norm(foggy.points_l, axis=1) > 10.0
    assert np.sum(far & foggy.returned) < 0.5 * np.sum(clear.returned)
    assert np.sum(foggy.returned & ~far) > 500
