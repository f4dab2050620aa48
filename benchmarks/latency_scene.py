"""What the bench of latency works on: a second before the hub, as the simulator's sensor has it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from config.settings import Settings
from config.simulation import Simulation
from config.turbine import Site, Turbine
from drivers.simulated.link import TruthState
from drivers.simulated.mesh import Part
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.rotor_frame import RotorFrame, rotor_frame
from drivers.simulated.scanner import Scanner
from drivers.simulated.scene import draw_scene
from drivers.simulated.truth_history import TruthHistory
from perception.deskew import points_in_world
from perception.geometry import quaternion_from_rotation, rotation_from_euler
from perception.values import Float, Pose, Scan

TURBINE = "nrel-2.3-116"
STAND_OFF_M = 20.0
SECONDS = 1.0
STATES_PER_S = 50


@dataclass(frozen=True, slots=True, eq=False)
class Second:
    """One second of hovering, and what perception is told beside it. World ENU, metres."""

    points_w: Float
    """(N, 3) all trusted returns."""
    turbine_w: Float
    """(M, 3) those of the turbine."""
    eye_w: Float
    scan: Scan
    """The last tenth of it, as the sensor delivers it."""
    poses: tuple[Pose, ...]
    hub_w: Float
    normal_w: Float
    prior_hub_w: Float
    """Two metres wrong."""
    blade_w: tuple[Float, Float]
    """Root and tip of the blade that hangs lowest."""
    turbine: Turbine
    caster: Raycaster
    history: TruthHistory


def second_before_hub(seed: int) -> Second:
    """Return what a hovering vehicle sees of the turbine that the seed draws."""
    settings = Settings(
        sites=(Site(name="bench", turbine=TURBINE),), simulation=Simulation(seed=seed)
    )
    scene = draw_scene(settings)
    frame = rotor_frame(scene)
    caster, history = Raycaster(scene, settings), TruthHistory()
    poses = _hover(frame)
    for pose in poses:
        history.add(_state(pose))
    scanner = Scanner(caster, history, settings.lidar, seed)
    clouds, turbine = [], []
    for k in range(round(10 * SECONDS)):
        raw = scanner.scan(0.1 * k, 0.1)
        kept = raw.returned & (raw.tag == 0)
        scan = Scan(
            stamp_s=raw.t0_s + 0.1,
            sequence=k,
            points_l=raw.points_l[kept],
            age_s=(0.1 - raw.offsets_s[kept]).astype(np.float32),
            reflectivity=raw.reflectivity[kept],
            tag=raw.tag[kept],
        )
        points, _ = points_in_world(scan, poses, settings.lidar)
        clouds.append(points)
        turbine.append(points[raw.part[kept] <= Part.TOWER])
    lowest = min(frame.blades, key=lambda blade: float(blade.axis_w[2]))
    reach = scene.turbine.hub_radius_m + scene.turbine.blade_length_m
    return Second(
        points_w=np.concatenate(clouds),
        turbine_w=np.concatenate(turbine),
        eye_w=poses[0].position_w,
        scan=scan,
        poses=poses,
        hub_w=frame.hub_w,
        normal_w=frame.normal_w,
        prior_hub_w=frame.hub_w + np.array([1.2, -1.2, 1.0]),
        blade_w=(
            frame.hub_w + scene.turbine.hub_radius_m * lowest.axis_w,
            frame.hub_w + reach * lowest.axis_w,
        ),
        turbine=scene.turbine,
        caster=caster,
        history=history,
    )


def _hover(frame: RotorFrame) -> tuple[Pose, ...]:
    level = frame.upwind_level_w
    heading = rotation_from_euler(0.0, 0.0, math.atan2(-level[1], -level[0]))
    quaternion = quaternion_from_rotation(heading)
    eye = frame.hub_w + STAND_OFF_M * level
    count = round(STATES_PER_S * (SECONDS + 0.2))
    return tuple(Pose(k / STATES_PER_S, eye, quaternion, np.zeros(3)) for k in range(count))


def _state(pose: Pose) -> TruthState:
    east, north, up = (float(value) for value in pose.position_w)
    w, x, y, z = (float(value) for value in pose.quaternion_wb)
    still = (0.0, 0.0, 0.0)
    return TruthState(
        pose.stamp_s, (east, north, up), still, (w, x, y, z), still, (1.0, 0.0, 0.0, 0.0), 0.0
    )
