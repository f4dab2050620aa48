"""The autopilot's side of the frames: NED and FRD from and to the world's ENU and FLU."""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.simulated.vehicle import Quaternion, Vec3

_EARTH_M = 6_378_137.0
_HALF = math.sqrt(0.5)


@dataclass(frozen=True, slots=True)
class Home:
    """Geodetic place of the local origin."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float

    def geodetic(self, position_l: Vec3) -> tuple[float, float, float]:
        """Return latitude, longitude (degrees) and altitude of a local ENU position."""
        north = math.degrees(position_l[1] / _EARTH_M)
        east = math.degrees(position_l[0] / (_EARTH_M * math.cos(math.radians(self.latitude_deg))))
        return (
            self.latitude_deg + north,
            self.longitude_deg + east,
            self.altitude_m + position_l[2],
        )


def swapped(v: Vec3) -> Vec3:
    """Return ENU as NED, or NED as ENU: the turn is its own inverse."""
    return (v[1], v[0], -v[2])


def turned(angle_rad: float) -> float:
    """Return an ENU yaw as NED heading, or the other way round, in (-pi, pi]."""
    return math.remainder(math.pi / 2 - angle_rad, 2 * math.pi)


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the quaternion product (w, x, y, z): first b's rotation, then a's."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def inverse(q: Quaternion) -> Quaternion:
    """Return the inverse of a unit quaternion."""
    return (q[0], -q[1], -q[2], -q[3])


def ned_quaternion(quaternion_wb: Quaternion) -> Quaternion:
    """Return the rotation of FRD into NED for one of FLU into ENU, w >= 0."""
    w, x, y, z = product(product((0.0, _HALF, _HALF, 0.0), quaternion_wb), (0.0, 1.0, 0.0, 0.0))
    return (w, x, y, z) if w >= 0 else (-w, -x, -y, -z)


def euler(quaternion: Quaternion) -> Vec3:
    """Return roll, pitch and yaw of the order z-y-x, radians."""
    w, x, y, z = quaternion
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(min(max(2 * (w * y - z * x), -1.0), 1.0))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return roll, pitch, yaw


def rates_b(before: Quaternion, after: Quaternion, dt_s: float) -> Vec3:
    """Return the mean angular rate over a step, in the body's frame, rad/s."""
    w, x, y, z = product(inverse(before), after)
    scale = (2.0 if w >= 0 else -2.0) / dt_s
    return (x * scale, y * scale, z * scale)


def enu_quaternion(ned_q: Quaternion) -> Quaternion:
    """Return the rotation of FLU into ENU for one of FRD into NED, w >= 0."""
    # Both turns are their own inverse, up to the sign that w >= 0 takes away.
    return ned_quaternion(ned_q)
