"""The guard: the only way to the vehicle. It re-checks every setpoint, whoever asked for it.

Clearance is the least of the points around (live scan and what was found occupied in this flight)
and of the fitted model, measured from the airframe's outermost point. A setpoint passes only if
the vehicle, obeying it for ever, stays clear: the place where it comes to rest and the way there
are checked, and the speed towards everything near obeys

    d - 1.1 v - v^2 / 4 >= 8,

what PX4 needs to stop when this process dies (d metres, v m/s). What does not pass becomes a hold,
or, nearer than the clearance, a slow move outward where outward is free. Pure and stateless: the
same arguments give the same answer, so a recording can be checked anew.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from config.settings import Settings
from mission.flight.command import Command, Phase, Setpoint
from mission.flight.observation import Observation, Vec3
from mission.flight.rotor_model import RotorModel
from mission.flight.seen_space import SeenSpace
from perception.geometry import vec3
from perception.values import Float

#: PX4 comes to rest this long after a setpoint's velocity beyond its position (1 / MPC_XY_P).
REST_S = 1 / 0.95
#: A plan's corridor: how far from its lines the vehicle may be sent.
CORRIDOR_M = 6.0
#: Within this of the model, or of the tower's axis while there is none, is near the turbine.
NEAR_M = 25.0
POSITION_STALE_S = 0.5
#: A point stands for the returns of a voxel of 0.5 m: past its middle the surface may come nearer
#: by half of that, at a blade's tip or edge.
POINT_ERROR_M = 0.25
RETREAT_MPS = 0.5
#: A setpoint that leads no farther moves nothing.
STILL_M = 0.05
TICK_S = 0.05
LEAVING = frozenset({Phase.STAND_OFF, Phase.RETURN})


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """Occupied points of this flight near the vehicle, thinned."""

    points_w: Float
    """(N, 3)"""
    stamp_s: float
    """Of the newest scan in it."""


NOTHING_AROUND = Surroundings(np.zeros((0, 3)), float("-inf"))


@dataclass(frozen=True, slots=True, eq=False)
class Airspace:
    """What the mission knows of the turbine: what is closed, what the plan opened."""

    sphere_w: Float | None
    """(3,) centre of the closed sphere: the prior hub."""
    sphere_radius_m: float
    open: bool
    """The rotor is known and still."""
    model: RotorModel | None
    corridor_w: Float
    """(M, 3) points of the plan's lines, about a metre apart."""
    home_w: Vec3 | None
    seen: SeenSpace | None = None
    """Where the LiDAR has looked, while nothing else is known of the inside of the sphere."""
    drift_w: Float = field(default_factory=lambda: np.zeros(3))
    """(3,) by which model and corridor lie elsewhere in the vehicle's frame by now."""


@dataclass(frozen=True, slots=True)
class GuardedCommand:
    """What is sent, and why it differs from what was asked."""

    command: Command
    reason: str
    """Empty: passed unchanged."""
    refused: bool
    """The setpoint was replaced by a hold or a retreat (not merely trimmed)."""
    clearance_m: float | None
    """Least distance now, from the airframe's outermost point; None: nothing known near."""


def allowed_closing_mps(distances_m: Float, min_clearance_m: float) -> Float:
    """Return (N,) the largest v with d - 1.1 v - v^2 / 4 >= the clearance; 0 nearer than that."""
    room = np.maximum(distances_m - min_clearance_m, 0.0)
    return np.asarray(np.sqrt(4.84 + 4 * room) - 2.2)


class Guard:
    """Checks commands against the bounds of `Settings.guard`."""

    def __init__(self, settings: Settings) -> None:
        self._bounds = settings.guard
        self._airframe = settings.airframe

    def check(
        self,
        command: Command,
        observation: Observation,
        surroundings: Surroundings,
        airspace: Airspace,
        previous: Setpoint | None = None,
    ) -> GuardedCommand:
        """Return the command as it may be sent. ``previous`` is the setpoint last sent."""
        vehicle = observation.vehicle
        if command.setpoint is None:
            return GuardedCommand(command, "", False, None)
        if vehicle is None or observation.now_s - vehicle.stamp_s > POSITION_STALE_S:
            # Without a position there is no safe place to name: silence is the failsafe.
            silent = replace(command, setpoint=None)
            return GuardedCommand(silent, "the position is too old", True, None)
        here = np.array(vehicle.position_w)
        if not np.isfinite(here).all() or not math.isfinite(vehicle.yaw_rad):
            silent = replace(command, setpoint=None)
            return GuardedCommand(silent, "the position is not a number", True, None)
        asked = command.setpoint
        finite = all(
            math.isfinite(x) for x in (*asked.position_w, *asked.velocity_w, asked.yaw_rad)
        )
        near = _Near(here, surroundings, airspace, self._airframe.radius_m)
        hold = Setpoint(vehicle.position_w, (0.0, 0.0, 0.0), vehicle.yaw_rad)
        if not finite:
            return self._answer(command, hold, "the setpoint is not a number", True, near)
        hold = replace(hold, yaw_rad=asked.yaw_rad)
        leaving = command.progress.phase in LEAVING
        trimmed, trim = self._trim(asked, here, near, previous)
        reason = (
            self._outside_bounds(trimmed, here, airspace)
            or self._blind(observation, near, leaving, trimmed, here)
            or self._closed(trimmed, here, airspace, leaving)
            or self._unseen(trimmed, here, airspace, leaving)
        )
        if reason:
            return self._answer(command, hold, reason, True, near)
        if near.nearest_m < self._bounds.min_clearance_m:
            if near.moves_outward(trimmed, self._bounds.min_clearance_m):
                return self._answer(command, trimmed, trim, False, near)
            retreat = near.retreat(hold)
            return self._answer(command, retreat, "nearer than the clearance", True, near)
        slowed, too_fast = self._slow_closing(trimmed, here, np.array(vehicle.velocity_w), near)
        if too_fast:
            # What pushes the vehicle on is not braked by a place that moves along with it.
            retreat = near.retreat(hold)
            return self._answer(command, retreat, "closing too fast to stop in time", True, near)
        if not near.path_is_clear(slowed, self._bounds.min_clearance_m):
            return self._answer(command, hold, "the way there is not clear", True, near)
        words = trim if slowed == trimmed else "slowed towards an obstacle"
        return self._answer(command, slowed, words, False, near)

    def _answer(
        self, command: Command, setpoint: Setpoint, reason: str, refused: bool, near: _Near
    ) -> GuardedCommand:
        clearance = near.nearest_m if math.isfinite(near.nearest_m) else None
        sent = command if setpoint == command.setpoint else replace(command, setpoint=setpoint)
        return GuardedCommand(sent, reason, refused, clearance)

    def _trim(
        self, asked: Setpoint, here: Float, near: _Near, previous: Setpoint | None
    ) -> tuple[Setpoint, str]:
        """Bound lead, speed and growth of speed; these are corrected, not refused."""
        bounds, words = self._bounds, ""
        position, velocity = np.array(asked.position_w), np.array(asked.velocity_w)
        lead = position - here
        far = float(np.linalg.norm(lead))
        if far > bounds.max_lead_m + 1e-9:
            position, words = here + lead * (bounds.max_lead_m / far), "lead trimmed"
        limit = bounds.max_speed_near_mps if near.is_near else self._airframe.max_speed_mps
        speed = float(np.linalg.norm(velocity))
        if speed > limit + 1e-9:
            velocity, words = velocity * (limit / speed), "speed trimmed"
        before = np.zeros(3) if previous is None else np.array(previous.velocity_w)
        change = velocity - before
        most = 1.5 * self._airframe.max_acceleration_mps2 * TICK_S
        grown = float(np.linalg.norm(change))
        if grown > most + 1e-9 and np.linalg.norm(velocity) > np.linalg.norm(before):
            velocity, words = before + change * (most / grown), "acceleration trimmed"
        if not words:
            return asked, ""
        return Setpoint(vec3(position), vec3(velocity), asked.yaw_rad), words

    def _outside_bounds(self, setpoint: Setpoint, here: Float, airspace: Airspace) -> str:
        """Cylinder and height, round the take-off point; moving back inside is allowed."""
        home = np.zeros(3) if airspace.home_w is None else np.array(airspace.home_w)
        rest = _rest(setpoint)
        out = float(np.hypot(*(rest - home)[:2]))
        limit = self._bounds.cylinder_radius_m
        if out > limit and out > float(np.hypot(*(here - home)[:2])):
            return "outside the cylinder round the take-off point"
        height = float(rest[2] - home[2])
        if height > self._bounds.max_height_m and rest[2] > here[2]:
            return "above the height limit"
        if height < 2.0 and rest[2] < here[2] - 1e-6:
            return "too low"
        return ""

    def _blind(
        self,
        observation: Observation,
        near: _Near,
        leaving: bool,
        setpoint: Setpoint,
        here: Float,
    ) -> str:
        """Near the turbine nothing moves on old scans, except outward along the known way."""
        scan, oldest_s = observation.clearance, observation.now_s - self._bounds.scan_hold_s
        fresh = scan is not None and not scan.repeated and scan.stamp_s >= oldest_s
        least_m = self._bounds.min_clearance_m
        if fresh or not near.is_near or (leaving and near.moves_outward(setpoint, least_m)):
            return ""
        still = float(np.linalg.norm(_rest(setpoint) - here)) < STILL_M
        known_way = leaving and near.on_corridor(_rest(setpoint))
        return "" if still or known_way else "no fresh scan"

    def _closed(self, setpoint: Setpoint, here: Float, airspace: Airspace, leaving: bool) -> str:
        """Keep out of the sphere round the prior hub, or in the plan's corridors inside it."""
        if airspace.sphere_w is None:
            return ""
        rest = _rest(setpoint)
        then = float(np.linalg.norm(rest - airspace.sphere_w))
        if then >= airspace.sphere_radius_m:
            return ""
        now = float(np.linalg.norm(here - airspace.sphere_w))
        if then >= now - 1e-6:
            return ""
        if not airspace.open and not leaving:
            return "the sphere round the rotor is closed"
        # The way being flown is opened where the vehicle is, the plan's lines where they were laid.
        moved = rest - airspace.drift_w
        if not _within(rest, airspace.corridor_w, CORRIDOR_M) and not _within(
            moved, airspace.corridor_w, CORRIDOR_M
        ):
            return "outside the plan's corridors"
        return ""

    def _unseen(self, setpoint: Setpoint, here: Float, airspace: Airspace, leaving: bool) -> str:
        """Inside the sphere, where only the LiDAR knows, nothing is entered that it never saw."""
        if airspace.sphere_w is None or airspace.seen is None or leaving:
            return ""
        rest = _rest(setpoint)
        moved = rest - here
        far = float(np.linalg.norm(moved))
        inside = float(np.linalg.norm(rest - airspace.sphere_w)) < airspace.sphere_radius_m
        if far < STILL_M or not inside:
            return ""
        tip = rest + moved * (self._airframe.radius_m / far)
        return "" if airspace.seen.seen(np.stack([rest, tip])) else "a place never seen"

    def _slow_closing(
        self, setpoint: Setpoint, here: Float, velocity: Float, near: _Near
    ) -> tuple[Setpoint, bool]:
        """Scale the setpoint so that the speed it gives towards anything near may be stopped."""
        if not len(near.distances):
            return setpoint, False
        lead = np.array(setpoint.position_w) - here
        fed = np.array(setpoint.velocity_w)
        flown = near.units @ velocity
        allowed = allowed_closing_mps(near.distances, self._bounds.min_clearance_m)
        # The vehicle's own speed lags what was asked for: only a real excess is an excess.
        if bool((flown > allowed + 0.3).any()):
            return setpoint, True
        slid, slid_fed = _without_closing(lead, fed, near.units, allowed)
        if slid is lead:
            return setpoint, False
        return Setpoint(vec3(here + slid), vec3(slid_fed), setpoint.yaw_rad), False


def _without_closing(lead: Float, fed: Float, units: Float, allowed: Float) -> tuple[Float, Float]:
    """Return lead and velocity without what closes on anything faster than allowed.

    What closes on nothing too fast comes back as it is: the very arrays. Else only the part towards
    the obstacle is taken away, so that the vehicle slides along it; where several hem it in, all of
    the motion is scaled down.
    """
    slid, slid_fed = lead, fed
    for _ in range(6):
        asked = units @ (0.95 * slid + slid_fed)
        worst = int((asked - allowed).argmax())
        if asked[worst] <= allowed[worst] + 1e-6:
            return slid, slid_fed
        share = (asked[worst] - allowed[worst]) / asked[worst]
        toward = units[worst]
        slid = slid - share * (slid @ toward) * toward
        slid_fed = slid_fed - share * (slid_fed @ toward) * toward
    asked = units @ (0.95 * lead + fed)
    over = asked > allowed + 1e-6
    scale = float((allowed[over] / asked[over]).min())
    return scale * lead, scale * fed


class _Near:
    """Everything within reach of the vehicle: distances, directions, and the ways past it."""

    def __init__(
        self, here: Float, surroundings: Surroundings, airspace: Airspace, radius_m: float
    ) -> None:
        self._here, self._model, self._radius = here, airspace.model, radius_m
        self._corridor, self._drift = airspace.corridor_w, airspace.drift_w
        offsets = surroundings.points_w - here
        apart = np.sqrt(np.einsum("nk,nk->n", offsets, offsets))
        close = apart < NEAR_M + 5.0
        self._points = surroundings.points_w[close]
        distances = [apart[close] - POINT_ERROR_M - radius_m]
        units = [offsets[close] / np.maximum(apart[close], 1e-6)[:, None]]
        model_m = np.array([math.inf])
        if self._model is not None:
            model_m, nearest = self._model.nearest(here - self._drift)
            toward = nearest + self._drift - here
            length = np.maximum(np.linalg.norm(toward, axis=1), 1e-6)
            distances.append(model_m - radius_m)
            units.append(toward / length[:, None] * np.sign(model_m)[:, None])
        self.distances: Float = np.concatenate(distances)
        self.units: Float = np.concatenate(units)
        self.nearest_m = float(self.distances.min(initial=math.inf))
        self.is_near = self._model is not None and float(model_m.min()) - radius_m < NEAR_M
        if airspace.sphere_w is not None:
            to_hub = here - airspace.sphere_w
            beside_tower = float(np.hypot(to_hub[0], to_hub[1])) < NEAR_M
            inside = float(np.linalg.norm(to_hub)) < airspace.sphere_radius_m
            self.is_near = self.is_near or inside or beside_tower

    def clearance(self, places: Float) -> tuple[float, float]:
        """Return the least clearance of places (K, 3) to the points, and to the model."""
        to_points = to_model = math.inf
        if len(self._points):
            apart = places[:, None, :] - self._points[None, :, :]
            nearest_sq = float(np.einsum("knc,knc->kn", apart, apart).min())
            to_points = math.sqrt(nearest_sq) - POINT_ERROR_M - self._radius
        if self._model is not None:
            to_model = float(self._model.distance(places - self._drift).min()) - self._radius
        return to_points, to_model

    def path_clearance(self, setpoint: Setpoint) -> float:
        """Return the least clearance from here over the setpoint to where the vehicle rests."""
        return min(self.clearance(_way(setpoint)))

    def path_is_clear(self, setpoint: Setpoint, clearance_m: float) -> bool:
        """Return whether the whole way keeps a clearance.

        Moving by x brings nothing nearer by more than x: mostly that settles it.
        """
        reach = float(np.linalg.norm(_way(setpoint) - self._here, axis=1).max())
        if self.nearest_m - reach >= clearance_m:
            return True
        return self.path_clearance(setpoint) >= clearance_m

    def moves_outward(self, setpoint: Setpoint, clearance_m: float) -> bool:
        """Return whether the setpoint nowhere comes nearer to anything than the vehicle is.

        The model is inflated: nearer to it than to the points, the clearance to these is kept too.
        """
        if float(np.linalg.norm(_rest(setpoint) - self._here)) < 1e-3:
            return False
        now, then = self.clearance(self._here[None]), self.clearance(_way(setpoint))
        kept = all(b >= min(a, clearance_m) - 1e-3 for a, b in zip(now, then, strict=True))
        return kept and min(then) >= self.nearest_m - 1e-3

    def on_corridor(self, place: Float) -> bool:
        """Return whether a place lies on a way that the plan found clear."""
        moved = place - self._drift
        return _within(place, self._corridor, CORRIDOR_M) or _within(
            moved, self._corridor, CORRIDOR_M
        )

    def retreat(self, hold: Setpoint) -> Setpoint:
        """Return a slow move away from what is nearest, or the hold where that is not free."""
        away = -self.units[int(self.distances.argmin())]
        lead, fed = 0.8 * away, RETREAT_MPS * away
        move = Setpoint(vec3(self._here + lead), vec3(fed), hold.yaw_rad)
        return move if self.path_clearance(move) > self.nearest_m + 0.2 else hold


def _rest(setpoint: Setpoint) -> Float:
    """Return where a vehicle that obeys the setpoint for ever comes to rest."""
    return np.array(setpoint.position_w) + REST_S * np.array(setpoint.velocity_w)


def _way(setpoint: Setpoint) -> Float:
    """Return places (3, 3) from the setpoint to where the vehicle comes to rest."""
    position, rest = np.array(setpoint.position_w), _rest(setpoint)
    return np.stack([position, (position + rest) / 2, rest])


def _within(place: Float, points: Float, reach_m: float) -> bool:
    if not len(points):
        return False
    apart = points - place
    return float(np.einsum("nk,nk->n", apart, apart).min()) <= reach_m * reach_m
