"""Return: round the turbine outside the sphere, over home, and the autopilot's own landing."""

from __future__ import annotations

import math

import numpy as np

from mission.flight.around import arc, at_bearing, bearing_rad
from mission.flight.command import Action, Phase, SensingMode
from mission.flight.flight import Flight, Intent
from mission.flight.observation import FlightMode
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

    def resume(self, _flight: Flight) -> None:
        """Work the way out again from here."""
        self._moving = False

    def step(self, flight: Flight) -> Intent:
        """Fly home; over home, land."""
        flight.sense(SensingMode.IDLE)
        if self._asked_s is not None:
            return self._land(flight)
        if not self._moving:
            self._moving = True
            flight.go(way_home(flight), flight.settings.airframe.max_speed_mps)
        home = np.array(flight.home_w or flight.vehicle.position_w)
        ahead = flight.follower.path
        goal = home if ahead is None else ahead.end_w
        setpoint = flight.follow(flight.yaw_to(goal))
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
    home = np.array(flight.home_w or flight.vehicle.position_w)
    low = float(home[2]) + TRANSIT_HEIGHT_M
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
