"""Where hub, shaft and blades of a scene truly are: the design's definitions made into vectors.

World ENU, metres, radians. Written apart from `perception.rotor`, so that a slip in one of them
shows as a difference rather than cancelling.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drivers.simulated.scene import Scene
from perception.values import Float

_DOWN: Float = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, slots=True, eq=False)
class BladeFrame:
    """One blade's directions in the world, unit vectors (3,)."""

    axis_w: Float
    """Along the pitch axis, from the hub outward, cone included."""
    towards_rotation_w: Float
    """In the rotor plane, where the leading edge points at pitch 0."""
    upwind_w: Float
    """At right angles to the two above: where the pressure side faces at pitch 0."""
    pitch_rad: float

    def leading_w(self, twist_rad: float = 0.0) -> Float:
        """Return where the leading edge points at a station of the given twist."""
        angle = self.pitch_rad + twist_rad
        return math.cos(angle) * self.towards_rotation_w + math.sin(angle) * self.upwind_w

    def pressure_w(self, twist_rad: float = 0.0) -> Float:
        """Return where the pressure side faces at a station of the given twist."""
        angle = self.pitch_rad + twist_rad
        return math.cos(angle) * self.upwind_w - math.sin(angle) * self.towards_rotation_w


@dataclass(frozen=True, slots=True, eq=False)
class RotorFrame:
    """The rotor at one moment."""

    hub_w: Float
    normal_w: Float
    """Downwind: from rotor to nacelle."""
    upwind_level_w: Float
    """Horizontal, into which the rotor faces."""
    blades: tuple[BladeFrame, BladeFrame, BladeFrame]


def rotor_frame(scene: Scene) -> RotorFrame:
    """Return the rotor of a scene as it stands at mission time 0."""
    yaw, tilt = math.radians(scene.nacelle_yaw_deg), math.radians(scene.tilt_deg)
    level = np.array([math.sin(yaw), math.cos(yaw), 0.0])
    # Tilt lifts the rotor's side of the shaft, so that the blades clear the tower.
    upwind = math.cos(tilt) * level + math.sin(tilt) * np.array([0.0, 0.0, 1.0])
    hub = scene.turbine.overhang_m * math.cos(tilt) * level
    hub = hub + np.array([0.0, 0.0, scene.turbine.hub_height_m])
    first, second, third = (
        _blade(scene, -upwind, math.radians(scene.stop_angle_deg + 120.0 * k), scene.pitch_deg[k])
        for k in range(3)
    )
    return RotorFrame(hub, -upwind, level, (first, second, third))


def _blade(scene: Scene, normal_w: Float, angle_rad: float, pitch_deg: float) -> BladeFrame:
    cone = math.radians(scene.cone_deg)
    down = _DOWN - (_DOWN @ normal_w) * normal_w
    down = down / np.linalg.norm(down)
    # A viewer in front looks along the normal with the sky up: his right is forward x up.
    right = np.cross(normal_w, -down)
    in_plane = math.cos(angle_rad) * down + math.sin(angle_rad) * right
    counter_clockwise = -math.sin(angle_rad) * down + math.cos(angle_rad) * right
    axis = math.cos(cone) * in_plane - math.sin(cone) * normal_w
    upwind = -math.cos(cone) * normal_w - math.sin(cone) * in_plane
    sign = -1.0 if scene.turbine.rotation == "clockwise" else 1.0
    return BladeFrame(axis, sign * counter_clockwise, upwind, math.radians(pitch_deg))


def blade_names(stop_angle_deg: float) -> tuple[str, str, str]:
    """Return the names of the blades at stop angle + 0, 120, 240 deg (design, Definitions)."""
    # In [0, 120) the first blade is A below 75 deg; from there on it is the next after A.
    return ("A", "B", "C") if stop_angle_deg < 75.0 else ("B", "C", "A")
