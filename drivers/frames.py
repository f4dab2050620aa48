"""Between the autopilot's frames (NED, body FRD) and ours (ENU, body FLU). Plain numbers."""

from __future__ import annotations

import math

from perception.geometry import wrap_angle

Vec3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

_HALF_SQRT = math.sqrt(0.5)


def swap_enu_ned(vector: Vec3) -> Vec3:
    """Return an ENU vector in NED, or a NED vector in ENU: the exchange is its own inverse."""
    return vector[1], vector[0], -vector[2]


def swap_yaw(yaw_rad: float) -> float:
    """Return an ENU yaw (0 east, anticlockwise) as a NED yaw (0 north, clockwise), or back."""
    return wrap_angle(math.pi / 2 - yaw_rad)


def swap_attitude(quaternion: Quaternion) -> Quaternion:
    """Return a FRD-to-NED quaternion (w x y z) as FLU-to-ENU, or back, with w >= 0."""
    w, x, y, z = quaternion
    # (0, 1, 1, 0) / sqrt(2) turns NED into ENU; (0, 1, 0, 0) turns FLU into FRD.
    turned = (
        _HALF_SQRT * (w + z),
        _HALF_SQRT * (x + y),
        _HALF_SQRT * (x - y),
        _HALF_SQRT * (w - z),
    )
    if turned[0] < 0:
        return -turned[0], -turned[1], -turned[2], -turned[3]
    return turned


def yaw_of(quaternion: Quaternion) -> float:
    """Return the rotation about the third axis (radians) of a body-to-world quaternion."""
    w, x, y, z = quaternion
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def pitch_up_of(quaternion: Quaternion) -> float:
    """Return how far the body's first axis points upward (radians); FLU-to-ENU quaternion."""
    w, x, y, z = quaternion
    return math.asin(max(-1.0, min(1.0, 2 * (x * z - w * y))))
