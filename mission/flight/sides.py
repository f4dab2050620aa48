"""Where the sides of a blade face: pressure, suction, leading and trailing edge.

Definitions (design, Sides): at pitch 0 the pressure side faces upwind and the leading edge points
towards the rotation; at pitch 90 the leading edge points upwind. Twist adds to pitch. PS and SS
are viewed along the chord's normal, LE and TE along the chord, at half span.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from config.turbine import Turbine
from perception.values import Float


@dataclass(frozen=True, slots=True, eq=False)
class BladeFrame:
    """A blade's undeflected pitch axis and the directions that its pitch turns. World ENU."""

    name: str
    root_w: Float
    """(3,) root flange: metre 0."""
    axis_w: Float
    """(3,) unit, root to tip."""
    rotation_w: Float
    """(3,) unit, perpendicular to the axis: where the blade moves when the rotor turns."""
    upwind_w: Float
    """(3,) unit, perpendicular to axis and rotation."""
    pitch_rad: float | None
    length_m: float

    @property
    def tip_w(self) -> Float:
        """(3,) end of the axis."""
        return self.root_w + self.length_m * self.axis_w

    def leading(self, angle_rad: float) -> Float:
        """Return the unit direction from trailing to leading edge at a section angle."""
        return math.cos(angle_rad) * self.rotation_w + math.sin(angle_rad) * self.upwind_w

    def pressure(self, angle_rad: float) -> Float:
        """Return the outward unit normal of the pressure side at a section angle."""
        return math.cos(angle_rad) * self.upwind_w - math.sin(angle_rad) * self.rotation_w


def blade_frame(
    name: str,
    hub_w: Float,
    normal_w: Float,
    direction_w: Float,
    pitch_deg: float | None,
    turbine: Turbine,
) -> BladeFrame:
    """Return the frame of a blade from the measured rotor. Vectors (3,), ``normal_w`` downwind."""
    axis: Float = direction_w / float(np.linalg.norm(direction_w))
    clockwise: Float = np.asarray(np.cross(normal_w, axis), np.float64)
    rotation = clockwise if turbine.rotation == "clockwise" else -clockwise
    rotation = rotation / float(np.linalg.norm(rotation))
    upwind = -normal_w + float(normal_w @ axis) * axis
    upwind = upwind / float(np.linalg.norm(upwind))
    pitch_rad = None if pitch_deg is None else math.radians(pitch_deg)
    root = hub_w + turbine.hub_radius_m * axis
    return BladeFrame(name, root, axis, rotation, upwind, pitch_rad, turbine.blade_length_m)


def half_span_angle_rad(frame: BladeFrame, turbine: Turbine) -> float:
    """Return the section angle at half span: measured pitch plus the catalogue's twist."""
    if frame.pitch_rad is None:
        raise ValueError(f"blade {frame.name} has no pitch")
    twist = np.interp(0.5, turbine.blade.span, turbine.blade.twist_deg)
    return frame.pitch_rad + math.radians(float(twist))


def side_view(frame: BladeFrame, side: str, turbine: Turbine) -> Float:
    """Return the unit direction (3,) from the blade's axis towards the viewer of a side."""
    angle = half_span_angle_rad(frame, turbine)
    view = frame.pressure(angle) if side in {"PS", "SS"} else frame.leading(angle)
    return view if side in {"PS", "LE"} else -view


def turned(view_w: Float, axis_w: Float, turn_rad: float) -> Float:
    """Return the view turned about the blade's axis. ``view_w`` is perpendicular to ``axis_w``."""
    beside: Float = np.asarray(np.cross(axis_w, view_w), np.float64)
    return math.cos(turn_rad) * view_w + math.sin(turn_rad) * beside
