"""Approach: round the turbine to the rotor's front, then along its axis to the stand-off d_c."""

from __future__ import annotations

import numpy as np

from mission.flight.around import arc, bearing_rad
from mission.flight.command import MissionState, Phase, SensingMode
from mission.flight.flight import Flight, Intent
from mission.flight.phases.estimate import Estimate
from mission.flight.phases.leave import leave
from perception.values import Float

ARC_SPEED_MPS = 5.0
STILL_S = 15.0
SIDE_LOST_S = 10.0
FRONT_WITHIN_M = 4.0
#: A goal that moves by more than this is flown to anew.
MOVED_M = 2.5


class Approach:
    """Arrive in front outside the sphere, make sure that the rotor stands still, go in."""

    phase = Phase.APPROACH

    def __init__(self) -> None:
        self._inward = False
        self._moving = False
        self._waiting_s: float | None = None
        self._goal: Float | None = None
        self._lost_s: float | None = None

    def resume(self, _flight: Flight) -> None:
        """Work the way out again from here."""
        self._moving = False

    def step(self, flight: Flight) -> Intent:
        """Fly round, wait until the rotor is known to be still, fly in."""
        normal = flight.normal_w
        if normal is None and self._unknown(flight):
            return Intent("looking for the side of the rotor", setpoint=flight.hold())
        if normal is None:
            words = "the side of the rotor is not known any more"
            return leave(flight, Intent(words, flight.hold()), MissionState.REFUSED, words)
        self._lost_s = None
        hub = flight.hub_w
        yaw, gimbal = flight.yaw_to(hub), flight.aim_at(hub)
        if not self._inward:
            return self._round(flight, hub, normal, yaw)
        goal = hub - normal * flight.settings.estimation.stand_off_m
        if not self._moving or (
            self._goal is not None and np.linalg.norm(goal - self._goal) > MOVED_M
        ):
            self._moving, self._goal = True, goal
            speed = flight.settings.guard.max_speed_near_mps
            flight.go(goal[None], speed)
        setpoint = flight.follow(yaw)
        done = flight.arrived(1.0)
        return Intent(
            "approaching the hub", setpoint=setpoint, gimbal=gimbal,
            then=Estimate() if done else None,
        )  # fmt: skip

    def _unknown(self, flight: Flight) -> bool:
        """Return whether the side, lost from view, may still be seen again from here."""
        flight.sense(SensingMode.TOWER)
        self._moving = False
        if self._lost_s is None:
            self._lost_s = flight.now_s
        return flight.now_s - self._lost_s < SIDE_LOST_S

    def _round(self, flight: Flight, hub: Float, normal: Float, yaw: float) -> Intent:
        flight.sense(SensingMode.TOWER)
        front = bearing_rad(np.zeros(3), -normal)
        if not self._moving:
            here, radius = flight.here_w, flight.clear_radius_m
            height = float(hub[2])
            way = arc(hub, radius, bearing_rad(hub, here), front, float(here[2]), height)
            self._moving, self._goal = True, way[-1]
            flight.go(way, ARC_SPEED_MPS)
        moved = hub + (way_offset := _front_offset(front, flight.clear_radius_m))
        if self._goal is not None and np.hypot(*(moved - self._goal)[:2]) > FRONT_WITHIN_M:
            self._moving = False
        setpoint = flight.follow(yaw)
        gimbal = flight.aim_at(hub)
        words = "flying round to the front of the rotor"
        if not flight.arrived(1.5):
            return Intent(words, setpoint=setpoint, gimbal=gimbal)
        prior = flight.observation.hub_prior
        if prior is not None and prior.turning is False:
            flight.rotor_open = True
            flight.open_corridor([np.stack([hub + way_offset, hub - normal * 15.0])])
            self._inward, self._moving = True, False
            return Intent("the rotor stands still", setpoint=setpoint, gimbal=gimbal)
        if self._waiting_s is None:
            self._waiting_s = flight.now_s
        if flight.now_s - self._waiting_s > STILL_S:
            words = "it could not be told whether the rotor stands still"
            return leave(flight, Intent(words, setpoint), MissionState.REFUSED, words)
        return Intent("watching whether the rotor turns", setpoint=setpoint, gimbal=gimbal)


def _front_offset(front_rad: float, radius_m: float) -> Float:
    return radius_m * np.array([np.cos(front_rad), np.sin(front_rad), 0.0])
