"""Return: round the turbine outside the sphere, over home, and the autopilot's own landing."""

from __future__ import annotations

import math

import numpy as np

from mission.flight.around import arc, at_bearing, bearing_rad
from mission.flight.command import Action, Phase, SensingMode
from mission.flight.flight import HOME_MOVED_M, Flight, Intent
from mission.flight.observation import FlightMode, Vec3
from mission.flight.phases.landed import Landed
from perception.values import Float

TRANSIT_HEIGHT_M = 12.0
ASK_AGAIN_S = 3.0


class Home:
    """Fly home from outside the sphere and land there."""

    phase = Phase.RETURN

    def __init__(self) -> None:
        self._moving = False
        self._asked_s: float | None = None
        self._goal_w: Vec3 | None = None

    def resume(self, _flight: Flight) -> None:
        """Work the way out again from here."""
        self._moving = False

    def step(self, flight: Flight) -> Intent:
        """Fly home; over home, land; at a rendezvous, hold and hand back."""
        flight.sense(SensingMode.IDLE)
        if self._asked_s is not None:
            return self._land(flight)
        if self._goal_w is None or math.dist(self._goal_w, flight.goal_w) > HOME_MOVED_M:
            self._goal_w, self._moving = flight.goal_w, False
        if not self._moving:
            self._moving = True
            flight.go(way_home(flight), flight.settings.airframe.max_speed_mps)
        home = np.array(flight.goal_w)
        ahead = flight.follower.path
        goal = home if ahead is None else ahead.end_w
        setpoint = flight.follow(flight.yaw_to(goal))
        if flight.arrived(1.5) and flight.rendezvous_w is not None:
            flight.engaged, flight.land_asked_s = False, flight.now_s
            return Intent("handing back", action=Action.HOLD, then=Landed(flown=False))
        if flight.arrived(1.5):
            self._asked_s = flight.now_s
            return Intent("landing", setpoint=setpoint, action=Action.LAND)
        return Intent("flying home", setpoint=setpoint)

    def _land(self, flight: Flight) -> Intent:
        mode, vehicle = flight.vehicle.mode, flight.vehicle
        if mode is not FlightMode.OFFBOARD or (vehicle.landed and not vehicle.armed):
            return Intent("landing", then=Landed())
        if self._asked_s is not None and flight.now_s - self._asked_s > ASK_AGAIN_S:
            self._asked_s = flight.now_s
            return Intent("landing", setpoint=flight.hold(), action=Action.LAND)
        return Intent("landing", setpoint=flight.hold())


def way_home(flight: Flight) -> Float:
    """Return points (K, 3) from outside the sphere to above the take-off point."""
    here, hub = flight.here_w, flight.hub_w
    home = _outside(flight, np.array(flight.goal_w))
    low = float(home[2]) + (TRANSIT_HEIGHT_M if flight.rendezvous_w is None else 0.0)
    over = np.array([home[0], home[1], low])
    if math.hypot(*(here - home)[:2]) < 3.0:
        return over[None]
    radius = flight.clear_radius_m
    out = math.hypot(home[0] - hub[0], home[1] - hub[1])
    goal = bearing_rad(hub, home)
    start, height = bearing_rad(hub, here), float(here[2])
    if height <= low + 5.0 and math.hypot(*(here - hub)[:2]) > 0.9 * out:
        # Still low and on the launch's side of the turbine: the way that was come.
        return np.stack([np.array([here[0], here[1], low]), over])
    # Outside the sphere's equator any height is free: what takes longest is begun at once.
    way = arc(hub, radius, start, goal, height, low if out >= radius else max(low, height))
    if out < radius:
        way = np.concatenate([way, at_bearing(hub, goal, radius, low)[None]])
    return np.concatenate([way, over[None]])


def _outside(flight: Flight, goal_w: Float) -> Float:
    """Return the goal (3,); a rendezvous beside the rotor is moved straight out of the sphere."""
    offset = goal_w - flight.hub_w
    apart = float(np.linalg.norm(offset))
    if flight.rendezvous_w is None or apart >= flight.clear_radius_m:
        return goal_w
    moved: Float = flight.hub_w + offset * (flight.clear_radius_m / max(apart, 1e-6))
    return moved
