"""PX4-like cascade: position P -> velocity PID -> acceleration -> tilt and thrust; yaw beside it.

Works on the autopilot's estimate, not on the truth. Gains and limits are PX4's parameters, read at
each step so that a changed parameter acts at once. Frame: local ENU, metres, radians.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.simulated.px4_parameters import Parameters
from drivers.simulated.vehicle import GRAVITY_MPS2, AttitudeCommand, Vec3

_NAN3 = (math.nan, math.nan, math.nan)
#: First-order filter on the measured acceleration (MPC_VELD_LP 5 Hz).
_DERIVATIVE_S = 1 / (2 * math.pi * 5.0)
_YAW_P = 2.8


@dataclass(frozen=True, slots=True)
class Target:
    """What is to be flown; NaN leaves an axis of the position or velocity free."""

    position_w: Vec3 = _NAN3
    velocity_w: Vec3 = _NAN3
    acceleration_w: Vec3 = (0.0, 0.0, 0.0)
    yaw_rad: float = math.nan
    yaw_rate_rps: float = math.nan
    idle: bool = False
    """Motors idle: on the ground, or not armed."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """What the autopilot believes about itself."""

    position_w: Vec3
    velocity_w: Vec3
    yaw_rad: float


class PositionController:
    """State of the cascade: integrals and the filtered acceleration."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._integral = [0.0, 0.0, 0.0]
        self._last_velocity: Vec3 = (0.0, 0.0, 0.0)
        self._acceleration = [0.0, 0.0, 0.0]
        self._yaw_target: float | None = None

    def reset(self) -> None:
        """Forget the integrals, as at take-off."""
        self._integral = [0.0, 0.0, 0.0]
        self._acceleration = [0.0, 0.0, 0.0]
        self._yaw_target = None

    def step(self, target: Target, estimate: Estimate, dt_s: float) -> AttitudeCommand:
        """Return the attitude command for the next ``dt_s``."""
        if target.idle:
            self.reset()
            self._last_velocity = estimate.velocity_w
            return AttitudeCommand(0.0, 0.0, 0.0, 0.0)
        wanted = self._velocity_wanted(target, estimate)
        acceleration = self._velocity_loop(wanted, target, estimate, dt_s)
        lean_east, lean_north, thrust = self._limit(acceleration, wanted, estimate, dt_s)
        return AttitudeCommand(lean_east, lean_north, thrust, self._yaw_loop(target, estimate))

    def _velocity_wanted(self, target: Target, estimate: Estimate) -> Vec3:
        p = self._parameters
        gains = (p["MPC_XY_P"], p["MPC_XY_P"], p["MPC_Z_P"])
        wanted = [0.0, 0.0, 0.0]
        for i in range(3):
            goal, forward = target.position_w[i], target.velocity_w[i]
            if not math.isnan(forward):
                wanted[i] = forward
            if not math.isnan(goal):
                wanted[i] += gains[i] * (goal - estimate.position_w[i])
        horizontal = math.hypot(wanted[0], wanted[1])
        if horizontal > p["MPC_XY_VEL_MAX"]:
            wanted[0] *= p["MPC_XY_VEL_MAX"] / horizontal
            wanted[1] *= p["MPC_XY_VEL_MAX"] / horizontal
        up = min(max(wanted[2], -p["MPC_Z_VEL_MAX_DN"]), p["MPC_Z_VEL_MAX_UP"])
        return (wanted[0], wanted[1], up)

    def _velocity_loop(
        self, wanted: Vec3, target: Target, estimate: Estimate, dt_s: float
    ) -> list[float]:
        p = self._parameters
        velocity, last = estimate.velocity_w, self._last_velocity
        self._last_velocity = velocity
        blend = dt_s / (dt_s + _DERIVATIVE_S)
        result = [0.0, 0.0, 0.0]
        for i, axis in enumerate(("XY", "XY", "Z")):
            measured = (velocity[i] - last[i]) / dt_s
            self._acceleration[i] += blend * (measured - self._acceleration[i])
            result[i] = (
                target.acceleration_w[i]
                + p[f"MPC_{axis}_VEL_P_ACC"] * (wanted[i] - velocity[i])
                + self._integral[i]
                - p[f"MPC_{axis}_VEL_D_ACC"] * self._acceleration[i]
            )
        return result

    def _limit(
        self, acceleration: list[float], wanted: Vec3, estimate: Estimate, dt_s: float
    ) -> tuple[float, float, float]:
        """Return tilt tangents and thrust; vertical first, and no wind-up at the limits."""
        p = self._parameters
        east, north, up = acceleration
        specific_up = min(max(up + GRAVITY_MPS2, 0.2 * GRAVITY_MPS2), 1.8 * GRAVITY_MPS2)
        most = math.tan(math.radians(p["MPC_TILTMAX_AIR"]))
        lean_east, lean_north = east / specific_up, north / specific_up
        lean = math.hypot(lean_east, lean_north)
        shrink = min(1.0, most / lean) if lean > 0 else 1.0
        error = [w - v for w, v in zip(wanted, estimate.velocity_w, strict=True)]
        for i in (0, 1):
            # PX4's tracking anti-windup: the share that the limit cut off is taken back.
            cut = acceleration[i] * (1 - shrink) * 2 / p["MPC_XY_VEL_P_ACC"]
            self._integral[i] += (p["MPC_XY_VEL_I_ACC"] * (error[i] - cut)) * dt_s
        if specific_up == up + GRAVITY_MPS2:
            self._integral[2] += p["MPC_Z_VEL_I_ACC"] * error[2] * dt_s
        self._integral[2] = min(max(self._integral[2], -GRAVITY_MPS2), GRAVITY_MPS2)
        lean_east, lean_north = lean_east * shrink, lean_north * shrink
        thrust = specific_up * math.sqrt(1 + lean_east * lean_east + lean_north * lean_north)
        return lean_east, lean_north, thrust

    def _yaw_loop(self, target: Target, estimate: Estimate) -> float:
        if not math.isnan(target.yaw_rate_rps) and math.isnan(target.yaw_rad):
            self._yaw_target = None
            rate = target.yaw_rate_rps
        else:
            if not math.isnan(target.yaw_rad):
                self._yaw_target = target.yaw_rad
            elif self._yaw_target is None:
                self._yaw_target = estimate.yaw_rad
            error = math.remainder(self._yaw_target - estimate.yaw_rad, 2 * math.pi)
            rate = _YAW_P * error
            if not math.isnan(target.yaw_rate_rps):
                rate += target.yaw_rate_rps
        limit = math.radians(self._parameters["MPC_YAWRAUTO_MAX"])
        return min(max(rate, -limit), limit)
