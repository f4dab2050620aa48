"""A path becomes setpoints: bounded speed, acceleration and jerk, never far ahead of the vehicle.

PX4 does not smooth steps in position, so the path is shaped here. Corners are rounded, the speed
that each point allows (its cap, the curve, the braking distance to what follows) is worked out
once, and each tick moves a reference point along. The setpoint is that point with its velocity
fed forward; the point waits where the vehicle falls behind by more than the lead allowed.
"""

from __future__ import annotations

import math

import numpy as np

from config.airframe import Airframe
from mission.flight.command import Setpoint
from mission.flight.observation import Vec3
from perception.geometry import vec3, wrap_angle
from perception.values import Float

STEP_M = 0.25
#: Half the length over which a corner is rounded; the corner is cut by about a third of it.
ROUNDING_M = 1.0
#: Braking is planned with this share of the acceleration, the rest is for the jerk limit.
BRAKING_SHARE = 0.6
#: Off the line, a velocity back onto it is added to what the autopilot's own gain gives, and speed
#: across the line is opposed. Tuned on `drivers.simulated`'s vehicle for gusts at 9 m/s of wind;
#: half as much again is still well damped, with 0.1 s of delay.
BACK_PER_S, OPPOSED_SHARE = 1.0, 0.5
#: The measured velocity is smoothed by so much, and the velocity added stays below this.
ACROSS_TIME_S, MOST_BACK_MPS = 0.1, 0.8
#: On a way by a position that is not told by the LiDAR, so much beside the line is the position's
#: own noise; farther off a gust has pushed the vehicle, and it is brought back with so much more.
SLACK_M, MOST_FROM_GUST_MPS = 0.7, 1.6


class Path:
    """A polyline, resampled and rounded, with the speed allowed at each sample."""

    def __init__(self, points_w: Float, caps_mps: Float | float, airframe: Airframe) -> None:
        """Shape a polyline (K, 3); ``caps_mps`` is one cap, or one for each of its points."""
        pieces = np.linalg.norm(np.diff(points_w, axis=0), axis=1)
        keep = np.concatenate([[True], pieces > 1e-6])
        corners = points_w[keep]
        caps = np.broadcast_to(np.asarray(caps_mps, float), (len(points_w),))[keep]
        at = np.concatenate([[0.0], np.cumsum(pieces[pieces > 1e-6])])
        count = max(2, math.ceil(at[-1] / STEP_M) + 1)
        even = np.linspace(0.0, at[-1], count)
        raw = np.stack([np.interp(even, at, corners[:, k]) for k in range(3)], axis=1)
        self.points_w = _rounded(raw)
        steps = np.linalg.norm(np.diff(self.points_w, axis=0), axis=1)
        self.at_m = np.concatenate([[0.0], np.cumsum(steps)])
        self.length_m = float(self.at_m[-1])
        self.end_w: Float = self.points_w[-1]
        self._tangents = _tangents(self.points_w)
        self._speed = _speeds(self.points_w, self.at_m, np.interp(even, at, caps), airframe)

    def point(self, along_m: float) -> tuple[Float, Float]:
        """Return the point (3,) and the unit tangent (3,) at a length along the path."""
        index = int(np.searchsorted(self.at_m, along_m, side="right")) - 1
        index = min(max(index, 0), len(self.at_m) - 2)
        length = self.at_m[index + 1] - self.at_m[index]
        if length < 1e-9:
            return self.points_w[index], np.zeros(3)
        share = min(max((along_m - self.at_m[index]) / length, 0.0), 1.0)
        point = (1 - share) * self.points_w[index] + share * self.points_w[index + 1]
        # Turned along with the path, so that a curve does not step from sample to sample.
        tangent = (1 - share) * self._tangents[index] + share * self._tangents[index + 1]
        size = float(np.linalg.norm(tangent))
        return point, tangent / size if size > 1e-9 else tangent

    def speed(self, along_m: float) -> float:
        """Return the speed allowed at a length along the path."""
        return float(np.interp(along_m, self.at_m, self._speed))


def _rounded(points: Float) -> Float:
    """Average each sample with its neighbours; the ends stay where they are."""
    count = len(points)
    reach = min(round(ROUNDING_M / STEP_M), (count - 1) // 2)
    if reach < 1:
        return points
    index = np.arange(count)
    room = np.minimum(reach, np.minimum(index, count - 1 - index))
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(points, axis=0)])
    mean: Float = (total[index + room + 1] - total[index - room]) / (2 * room + 1)[:, None]
    return mean


def _tangents(points: Float) -> Float:
    along = np.gradient(points, axis=0)
    unit: Float = along / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    return unit


def _speeds(points: Float, at: Float, caps: Float, airframe: Airframe) -> Float:
    """Return the speed allowed at each sample: caps, curves, the airframe's limits, braking."""
    acceleration = airframe.max_acceleration_mps2
    if at[-1] < 1e-6:
        return np.zeros(len(points))
    tangent = _tangents(points)
    turn = np.linalg.norm(np.gradient(tangent, axis=0), axis=1) / np.maximum(np.gradient(at), 1e-6)
    allowed = np.minimum(caps, airframe.max_speed_mps)
    allowed = np.minimum(allowed, np.sqrt(0.8 * acceleration / np.maximum(turn, 1e-6)))
    rise = tangent[:, 2]
    limit = np.where(rise > 0, airframe.max_climb_mps, airframe.max_descent_mps)
    allowed = np.minimum(allowed, limit / np.maximum(np.abs(rise), 1e-6))
    allowed[-1] = 0.0
    braking = 2 * BRAKING_SHARE * acceleration * at
    later = np.minimum.accumulate((allowed**2 + braking)[::-1])[::-1]
    speeds: Float = np.sqrt(np.maximum(later - braking, 0.0))
    return speeds


class Follower:
    """Moves a reference point along paths, or holds; its state is what was last asked for."""

    def __init__(self, airframe: Airframe, max_lead_m: float) -> None:
        self._airframe = airframe
        # The guard's bound counts from the vehicle's newest position: stay a little inside.
        self._lead_m = 0.92 * max_lead_m
        self._path: Path | None = None
        self._along_m = 0.0
        self._speed = 0.0
        self._acceleration = 0.0
        self._hold_w: Float | None = None
        self._yaw: float | None = None
        self._across_w: Float = np.zeros(3)

    @property
    def path(self) -> Path | None:
        """The path that is being followed."""
        return self._path

    @property
    def left_m(self) -> float:
        """Length of the path still ahead of the reference point."""
        return 0.0 if self._path is None else self._path.length_m - self._along_m

    def start(self, path: Path) -> None:
        """Follow a path from its beginning, at the speed already flown in its direction."""
        along = 0.0
        if self._path is not None and self._speed > 0:
            along = float(self._path.point(self._along_m)[1] @ path.point(0.0)[1])
        self._path, self._along_m, self._hold_w = path, 0.0, None
        self._speed *= max(0.0, along)
        self._acceleration = 0.0

    def stop(self) -> None:
        """Forget path and hold point: the next hold is where the vehicle then is."""
        self._path = self._hold_w = None
        self._speed = self._acceleration = 0.0

    def hold(self, position_w: Vec3, yaw_rad: float, dt_s: float) -> Setpoint:
        """Return a setpoint that stays where the vehicle was when holding began."""
        self._path = None
        self._speed = self._acceleration = 0.0
        here = np.array(position_w)
        if self._hold_w is None or np.linalg.norm(self._hold_w - here) > self._lead_m:
            self._hold_w = here
        return Setpoint(vec3(self._hold_w), (0.0, 0.0, 0.0), self._turn(yaw_rad, dt_s))

    def follow(
        self,
        position_w: Vec3,
        yaw_rad: float,
        dt_s: float,
        *,
        slow: float = 1.0,
        shift_w: Float | None = None,
        velocity_w: Vec3 | None = None,
        slack: bool = False,
    ) -> Setpoint:
        """Return the next setpoint along the path.

        ``slow`` scales the speed (0 stops); ``shift_w`` moves the whole path, as LiDAR
        registration asks; ``velocity_w``, the vehicle's own, holds it to the line more firmly than
        the autopilot's gains do; with ``slack`` only where it is clearly off the line: for a line
        that the LiDAR does not see.
        """
        if self._path is None:
            return self.hold(position_w, yaw_rad, dt_s)
        path, self._hold_w = self._path, None
        here = np.array(position_w) - (0.0 if shift_w is None else shift_w)
        self._shape(slow * path.speed(self._along_m), dt_s)
        room = self._room(here)
        moved = min(self._speed * dt_s, room, self.left_m)
        self._along_m += max(moved, 0.0)
        point, tangent = path.point(self._along_m)
        lead = point - here
        far = float(np.linalg.norm(lead))
        if far > self._lead_m:
            point = here + lead * (self._lead_m / far)
        if shift_w is not None:
            point = point + shift_w
        velocity = tangent * (self._speed if self.left_m > 1e-3 else 0.0)
        if velocity_w is not None:
            velocity = velocity + self._back(lead, tangent, np.array(velocity_w), dt_s, slack)
        return Setpoint(vec3(point), vec3(velocity), self._turn(yaw_rad, dt_s))

    def _back(
        self, lead: Float, tangent: Float, velocity: Float, dt_s: float, slack: bool
    ) -> Float:
        """Return the velocity (3,) that is added to come back onto the line."""
        across = velocity - (velocity @ tangent) * tangent
        self._across_w = self._across_w + (across - self._across_w) * (
            dt_s / (ACROSS_TIME_S + dt_s)
        )
        off, most_mps = lead - (lead @ tangent) * tangent, MOST_BACK_MPS
        if slack:
            far = float(np.linalg.norm(off))
            if far <= SLACK_M:
                return np.zeros(3)
            off, most_mps = off * (1 - SLACK_M / far), MOST_FROM_GUST_MPS
        back: Float = BACK_PER_S * off - OPPOSED_SHARE * self._across_w
        size = float(np.linalg.norm(back))
        return back * min(1.0, most_mps / max(size, 1e-6))

    def arrived(self, position_w: Vec3, within_m: float = 0.6) -> bool:
        """Return whether the path is at its end and the vehicle near it."""
        if self._path is None:
            return True
        gap = float(np.linalg.norm(np.array(position_w) - self._path.end_w))
        return self.left_m < 0.05 and gap < within_m

    def _shape(self, wanted_mps: float, dt_s: float) -> None:
        frame = self._airframe
        limit = frame.max_acceleration_mps2
        # The acceleration from which the jerk limit can still come back to none in time.
        gap = wanted_mps - self._speed
        ease = math.sqrt(2 * frame.max_jerk_mps3 * abs(gap))
        target = math.copysign(min(limit, ease, abs(gap) / max(dt_s, 1e-3)), gap)
        most = frame.max_jerk_mps3 * dt_s
        self._acceleration += min(max(target - self._acceleration, -most), most)
        self._acceleration = min(max(self._acceleration, -limit), limit)
        self._speed = max(0.0, self._speed + self._acceleration * dt_s)
        if gap * (wanted_mps - self._speed) < 0:
            self._speed, self._acceleration = wanted_mps, 0.0

    def _room(self, here: Float) -> float:
        """Return how far the reference may move before it leads the vehicle by too much."""
        if self._path is None:
            return 0.0
        point, tangent = self._path.point(self._along_m)
        lead = float((point - here) @ tangent)
        return max(self._lead_m - lead, 0.0)

    def _turn(self, yaw_rad: float, dt_s: float) -> float:
        most = math.radians(self._airframe.max_yaw_rate_dps) * dt_s
        if self._yaw is None:
            self._yaw = yaw_rad
        step = wrap_angle(yaw_rad - self._yaw)
        self._yaw = wrap_angle(self._yaw + min(max(step, -most), most))
        return self._yaw

    def face(self, yaw_rad: float) -> None:
        """Take the vehicle's real heading as the one last asked for."""
        self._yaw = yaw_rad
