"""The rotor as measured: hub, axis, stop angle, blades. The result type of every method.

Definitions (design): ``normal`` points downwind, from rotor to nacelle; the stop
angle is measured in the rotor plane, seen from upwind, from straight down
counter-clockwise (towards the viewer's right) to the first blade's axis, in
[0, 120) degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from perception.values import Float


class RefusalCode(StrEnum):
    """Why no rotor was given out."""

    NO_POINTS = "no_points"
    NO_PLANE = "no_plane"
    NO_RING = "no_ring"
    TWO_BLADES = "two_blades"
    LOW_VISIBILITY = "low_visibility"
    SIDE_UNKNOWN = "side_unknown"
    ROTOR_TURNING = "rotor_turning"
    NOT_A_ROTOR = "not_a_rotor"
    NOT_CONVERGED = "not_converged"


@dataclass(frozen=True, slots=True)
class Refusal:
    """A typed 'no estimate', with the reason in words."""

    code: RefusalCode
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Blade:
    """One blade: its name, undeflected axis direction and, where measured, its pitch."""

    name: str
    """A, B or C."""
    direction_w: Float
    """(3,) unit vector from the hub along the pitch axis (cone included)."""
    pitch_deg: float | None
    """0 operating, 90 feathered; None where it could not be measured."""
    pitch_sigma_deg: float | None = None
    length_m: float | None = None
    """From the hub centre to the tip, where the tip was seen."""


@dataclass(frozen=True, slots=True, eq=False)
class Rotor:
    """A measured rotor in the frame of its input points (world ENU, metres)."""

    stamp_s: float
    hub_w: Float
    """(3,)"""
    normal_w: Float
    """(3,) unit, downwind: from rotor to nacelle."""
    stop_angle_deg: float
    sigma_deg: float
    reference: str
    """`tower` or `gravity`: what straight down was taken from."""
    blades: tuple[Blade, Blade, Blade]
    method: str
    cone_deg: float = 0.0
    points: int = 0


def down_in_plane(normal_w: Float, down_w: Float) -> Float:
    """Return the unit vector of ``down_w`` projected on the plane of ``normal_w``. Both (3,)."""
    projected: Float = down_w - (down_w @ normal_w) * normal_w
    return projected / math.sqrt(float(projected @ projected))


def right_in_plane(normal_w: Float, down_w: Float) -> Float:
    """Return the unit vector to the right of a viewer who looks along ``normal_w``."""
    # Written out: numpy's cross product takes longer than all else that is done with three numbers.
    a, b, c = (float(x) for x in down_in_plane(normal_w, down_w))
    x, y, z = (float(x) for x in normal_w)
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def direction_at(angle_rad: float, normal_w: Float, down_w: Float, cone_rad: float = 0.0) -> Float:
    """Return the unit direction at an angle from straight down.

    The angle runs counter-clockwise seen from the front. A positive cone leans the direction
    upwind, against ``normal_w``.
    """
    down = down_in_plane(normal_w, down_w)
    right = right_in_plane(normal_w, down_w)
    in_plane = math.cos(angle_rad) * down + math.sin(angle_rad) * right
    return math.cos(cone_rad) * in_plane - math.sin(cone_rad) * normal_w


def angle_of(direction_w: Float, normal_w: Float, down_w: Float) -> float:
    """Return the angle from straight down (radians, (-pi, pi]); see `direction_at`."""
    down = down_in_plane(normal_w, down_w)
    right = right_in_plane(normal_w, down_w)
    return math.atan2(float(direction_w @ right), float(direction_w @ down))


def blade_angles_deg(stop_angle_deg: float) -> tuple[float, float, float]:
    """Return the angles of blades A, B, C from straight down, each in (-180, 180].

    A is the blade in [-45, 75); B and C follow counter-clockwise (design, Definitions).
    """
    first = (stop_angle_deg + 45.0) % 120.0 - 45.0
    wrapped = [(first + 120.0 * k + 180.0) % 360.0 - 180.0 for k in range(3)]
    a, b, c = (180.0 if angle == -180.0 else angle for angle in wrapped)
    return a, b, c
