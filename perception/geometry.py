"""Rotations and the pinhole. World is ENU; body and LiDAR are FLU; the camera is optical."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from perception.values import Float

#: Columns are the optical axes (right, down, forward) in FLU coordinates.
FLU_FROM_OPTICAL: Float = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def rotation_from_quaternion(quaternion: ArrayLike) -> Float:
    """Return the (3, 3) rotation of a unit quaternion (w, x, y, z)."""
    w, x, y, z = np.asarray(quaternion, float)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_rotation(rotation: Float) -> Float:
    """Return the unit quaternion (w, x, y, z), w >= 0, of a (3, 3) rotation."""
    m = np.asarray(rotation, float)
    # Largest of the four squared components first, so that no division is by a small number.
    squares = np.array(
        [
            1 + m[0, 0] + m[1, 1] + m[2, 2],
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
        ]
    )
    rows = np.array(
        [
            [squares[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], squares[1], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[1, 0] + m[0, 1], squares[2], m[2, 1] + m[1, 2]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], squares[3]],
        ]
    )
    q: Float = rows[int(np.argmax(squares))]
    q = q / np.linalg.norm(q)
    return q if q[0] >= 0 else -q


def rotation_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Float:
    """Return Rz(yaw) Ry(pitch) Rx(roll): FLU in ENU, so positive pitch looks down."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def quaternion_from_euler(
    roll_rad: float, pitch_rad: float, yaw_rad: float
) -> tuple[float, float, float, float]:
    """Return the unit quaternion (w, x, y, z) of Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr = math.cos(roll_rad / 2), math.sin(roll_rad / 2)
    cp, sp = math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
    cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def lidar_in_body(nose_down_deg: float) -> Float:
    """Return the (3, 3) rotation of LiDAR FLU into body FLU for a nose-down mounting."""
    return rotation_from_euler(0.0, math.radians(nose_down_deg), 0.0)


def vec3(values: Float) -> tuple[float, float, float]:
    """Return a vector (3,) as plain numbers, as observations and messages hold it."""
    return float(values[0]), float(values[1]), float(values[2])


def heading_from_enu_yaw(yaw_rad: float) -> float:
    """Return the compass heading (degrees, [0, 360)) of an ENU yaw."""
    return (90.0 - math.degrees(yaw_rad)) % 360.0


def wrap_angle(angle_rad: float) -> float:
    """Return the angle in (-pi, pi]."""
    wrapped = math.remainder(angle_rad, 2 * math.pi)
    return math.pi if wrapped == -math.pi else wrapped


def camera_looking_along(direction_w: ArrayLike) -> Float:
    """Return the (3, 3) optical-to-world rotation that looks along a direction without roll.

    ``direction_w``: (3,), not vertical (a vertical one takes north as the picture's up).
    """
    forward = np.asarray(direction_w, float)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    if np.linalg.norm(right) < 1e-6:
        right = np.array([1.0, 0.0, 0.0])
    right = right / np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward], axis=1)


def pinhole_matrix(focal_px: float, width_px: int, height_px: int) -> Float:
    """Return the (3, 3) camera matrix with the principal point at the picture's centre."""
    return np.array(
        [[focal_px, 0.0, width_px / 2], [0.0, focal_px, height_px / 2], [0.0, 0.0, 1.0]]
    )


def stop_angle_difference_deg(a_deg: float, b_deg: float) -> float:
    """Return the circular difference a - b of two stop angles, in [-60, 60)."""
    return ((a_deg - b_deg + 60.0) % 120.0) - 60.0
