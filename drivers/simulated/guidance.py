"""What each mode flies: PX4's own trajectories for hold, take-off, return and landing.

One jerk-limited velocity profile serves them all; OFFBOARD passes the set-point through unsmoothed,
as PX4 does. Frame: local ENU (home at the origin), metres.
"""

from __future__ import annotations

import math

from drivers.simulated.position_control import Estimate, Target
from drivers.simulated.px4_modes import Commander, Landed, Mode
from drivers.simulated.px4_parameters import Parameters
from drivers.simulated.vehicle import Vec3

_NAN = math.nan


class SmoothVelocity:
    """Brings a velocity to a wanted one under limits of acceleration and jerk."""

    def __init__(self) -> None:
        self.velocity = [0.0, 0.0, 0.0]
        self._acceleration = [0.0, 0.0, 0.0]

    def restart(self, velocity_w: Vec3) -> None:
        """Start from the vehicle's velocity."""
        self.velocity = list(velocity_w)
        self._acceleration = [0.0, 0.0, 0.0]

    def step(self, wanted_w: Vec3, max_acceleration: float, jerk: float, dt_s: float) -> None:
        """Advance the profile by ``dt_s``."""
        missing = [wanted_w[i] - self.velocity[i] for i in range(3)]
        size = math.sqrt(sum(m * m for m in missing))
        # The acceleration that can still be taken back to zero in time.
        allowed = min(max_acceleration, math.sqrt(2 * jerk * size), size / dt_s)
        for i in range(3):
            goal = missing[i] / size * allowed if size > 1e-9 else 0.0
            change = min(max(goal - self._acceleration[i], -jerk * dt_s), jerk * dt_s)
            self._acceleration[i] += change
            self.velocity[i] += self._acceleration[i] * dt_s


class Guidance:
    """The set-point of the flown mode, tick by tick."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self.offboard = Target()
        """Newest set-point of the offboard link."""
        self._mode: Mode | None = None
        self._smooth = SmoothVelocity()
        self._point = [0.0, 0.0, 0.0]
        self._goal = [0.0, 0.0, 0.0]
        self._climbed = False

    def step(self, commander: Commander, estimate: Estimate, dt_s: float) -> Target:
        """Return what the position controller shall fly."""
        mode = commander.mode
        if mode is not self._mode:
            self._enter(mode, commander, estimate)
        if not commander.armed:
            return Target(idle=True)
        if mode is Mode.OFFBOARD:
            return self.offboard
        grounded = commander.landed is Landed.ON_GROUND
        if grounded and mode is not Mode.TAKEOFF:
            self._enter(mode, commander, estimate)
            return Target(idle=True)
        wanted = self._wanted(mode, estimate)
        p = self._parameters
        self._smooth.step(wanted, p["MPC_ACC_HOR"], p["MPC_JERK_AUTO"], dt_s)
        for i in range(3):
            self._point[i] += self._smooth.velocity[i] * dt_s
        if mode is Mode.ALTCTL:
            # Blind: no position to hold, it drifts with the wind and sinks.
            return Target((_NAN, _NAN, _NAN), (_NAN, _NAN, -p["MPC_LAND_SPEED"]))
        x, y, z = self._point
        vx, vy, vz = self._smooth.velocity
        return Target((x, y, z), (vx, vy, vz), yaw_rad=_NAN)

    def _enter(self, mode: Mode, commander: Commander, estimate: Estimate) -> None:
        self._mode = mode
        self._smooth.restart(estimate.velocity_w)
        self._point = list(estimate.position_w)
        self._goal = list(estimate.position_w)
        self._climbed = False
        if mode is Mode.TAKEOFF:
            self._goal[2] = commander.takeoff_height_m

    def _wanted(self, mode: Mode, estimate: Estimate) -> Vec3:
        """Return the velocity that the mode wants at the profile's own point."""
        p = self._parameters
        if mode is Mode.TAKEOFF:
            return (0.0, 0.0, self._climb_to(self._goal[2], p["MPC_TKO_SPEED"]))
        if mode is Mode.LAND:
            return (0.0, 0.0, -self._landing_speed())
        if mode is Mode.RETURN:
            return self._return_home(estimate)
        return (0.0, 0.0, 0.0)

    def _climb_to(self, height_m: float, speed_mps: float) -> float:
        missing = height_m - self._point[2]
        down = self._parameters["MPC_Z_V_AUTO_DN"]
        return min(max(missing, -down), speed_mps)

    def _landing_speed(self) -> float:
        p = self._parameters
        return p["MPC_LAND_SPEED"] if self._point[2] < p["MPC_LAND_ALT2"] else p["MPC_Z_V_AUTO_DN"]

    def _return_home(self, estimate: Estimate) -> Vec3:
        """Climb to the return height, straight home, down: PX4's RTL_TYPE 0."""
        p = self._parameters
        away = math.hypot(self._point[0], self._point[1])
        near = away < p["RTL_MIN_DIST"]
        if not self._climbed and not near and self._point[2] < p["RTL_RETURN_ALT"] - 0.5:
            return (0.0, 0.0, self._climb_to(p["RTL_RETURN_ALT"], p["MPC_Z_V_AUTO_UP"]))
        self._climbed = True
        if away > 0.5:
            # Slows down so that it stops at home under half of the allowed acceleration.
            speed = min(p["MPC_XY_CRUISE"], math.sqrt(p["MPC_ACC_HOR"] * away) * 0.7, away)
            east, north = -self._point[0] / away, -self._point[1] / away
            return (speed * east, speed * north, 0.0)
        if math.hypot(estimate.position_w[0], estimate.position_w[1]) > 2.0:
            return (0.0, 0.0, 0.0)
        return (0.0, 0.0, -self._landing_speed())
