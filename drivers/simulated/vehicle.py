"""The simulated multirotor: a point mass with drag, thrust along its tilting body axis, and yaw.

Quadratic drag against the wind, limits of tilt and thrust, second-order lag of the tilt and
first-order lags of thrust and yaw rate, integrated at 200 Hz of mission time. World frame ENU,
metres; body FLU. Plain floats on purpose: at this size they beat arrays by far.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

Vec3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

GRAVITY_MPS2 = 9.80665
STEP_S = 0.005


@dataclass(frozen=True, slots=True)
class Body:
    """Physical constants of the vehicle."""

    drag_per_m: float = 0.03
    """Horizontal quadratic drag over mass: 12 m/s of wind lean the vehicle by 24 deg."""
    drag_up_per_m: float = 0.04
    tilt_rate_rps: float = 11.0
    """Natural frequency of the attitude loop; about 0.15 s to follow a step."""
    tilt_damping: float = 0.85
    thrust_lag_s: float = 0.06
    yaw_lag_s: float = 0.15


@dataclass(frozen=True, slots=True)
class AttitudeCommand:
    """What the position controller asks of the body, held over a tick."""

    lean_east: float
    """Tangent of the tilt towards east and north."""
    lean_north: float
    thrust_mps2: float
    """Along the body's up axis; 0 idles on the ground."""
    yaw_rate_rps: float


class Multirotor:
    """True state of the vehicle."""

    def __init__(self, position_w: Vec3, yaw_rad: float, body: Body | None = None) -> None:
        self.body = body or Body()
        self.x, self.y, self.z = position_w
        self.vx = self.vy = self.vz = 0.0
        self.yaw_rad = yaw_rad
        self.yaw_rate_rps = 0.0
        self._lean = [0.0, 0.0]
        self._lean_rate = [0.0, 0.0]
        self.thrust_mps2 = 0.0
        self._ground_z = position_w[2]
        self.on_ground = True
        self.touchdown_mps = 0.0
        """Hardest descent onto the ground so far."""

    @property
    def position_w(self) -> Vec3:
        """Position of the body's centre."""
        return (self.x, self.y, self.z)

    @property
    def velocity_w(self) -> Vec3:
        """Velocity over ground."""
        return (self.vx, self.vy, self.vz)

    def quaternion_wb(self) -> Quaternion:
        """Return the attitude as w x y z."""
        return attitude_quaternion(self._lean[0], self._lean[1], self.yaw_rad)

    def step(self, command: AttitudeCommand, wind_w: Vec3, dt_s: float) -> None:
        """Advance by ``dt_s`` (a multiple of 5 ms) under a held command and wind."""
        for _ in range(max(round(dt_s / STEP_S), 1)):
            self._integrate(command, wind_w)

    def _integrate(self, command: AttitudeCommand, wind_w: Vec3) -> None:
        body, lean, rate, dt = self.body, self._lean, self._lean_rate, STEP_S
        wn = body.tilt_rate_rps
        stiff, damp = wn * wn, 2 * body.tilt_damping * wn
        rate[0] += (stiff * (command.lean_east - lean[0]) - damp * rate[0]) * dt
        rate[1] += (stiff * (command.lean_north - lean[1]) - damp * rate[1]) * dt
        lean[0] += rate[0] * dt
        lean[1] += rate[1] * dt
        thrust = self.thrust_mps2
        thrust += (command.thrust_mps2 - thrust) * dt / body.thrust_lag_s
        self.thrust_mps2 = thrust
        self.yaw_rate_rps += (command.yaw_rate_rps - self.yaw_rate_rps) * dt / body.yaw_lag_s
        self.yaw_rad += self.yaw_rate_rps * dt

        up = thrust / math.sqrt(1 + lean[0] * lean[0] + lean[1] * lean[1])
        rx, ry, rz = self.vx - wind_w[0], self.vy - wind_w[1], self.vz - wind_w[2]
        speed = math.sqrt(rx * rx + ry * ry + rz * rz)
        drag, drag_up = body.drag_per_m * speed, body.drag_up_per_m * speed
        self.vx += (up * lean[0] - drag * rx) * dt
        self.vy += (up * lean[1] - drag * ry) * dt
        self.vz += (up - GRAVITY_MPS2 - drag_up * rz) * dt
        self.z += self.vz * dt
        if self.z <= self._ground_z and self.vz <= 0:
            self._rest()
        else:
            self.on_ground = self.z <= self._ground_z
            self.x += self.vx * dt
            self.y += self.vy * dt

    def _rest(self) -> None:
        self.touchdown_mps = max(self.touchdown_mps, -self.vz)
        self.z, self.vx, self.vy, self.vz = self._ground_z, 0.0, 0.0, 0.0
        self._lean[:] = self._lean_rate[:] = [0.0, 0.0]
        self.yaw_rate_rps = 0.0
        self.on_ground = True


def attitude_quaternion(lean_east: float, lean_north: float, yaw_rad: float) -> Quaternion:
    """Return w x y z of a body that leans by tangents to east and north and looks along a yaw.

    The tilt turns the world's up onto the thrust axis by the shortest way, after the yaw.
    """
    scale = math.sqrt(1 + lean_east * lean_east + lean_north * lean_north)
    # Half angle of the turn from up (0, 0, 1) to (lean_east, lean_north, 1) / scale.
    w = math.sqrt((1 + 1 / scale) / 2)
    tx, ty = -lean_north / scale / (2 * w), lean_east / scale / (2 * w)
    cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    # tilt (w, tx, ty, 0) times yaw (cy, 0, 0, sy)
    return (w * cy, tx * cy + ty * sy, ty * cy - tx * sy, w * sy)
