"""Approach: watch that the rotor stands still, then along its axis to the stand-off d_c.

From before the rotor where the LiDAR sees it from outside the sphere; a large one is watched from
beside, where a tip is near.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Protocol

import numpy as np

from mission.flight.around import bearing_rad, before_hub
from mission.flight.command import MissionState, Phase, SensingMode
from mission.flight.flight import Flight, Intent, PhaseStep
from mission.flight.phases.estimate import Estimate
from mission.flight.phases.leave import leave
from mission.flight.watch_places import (
    FRONT,
    WatchPlace,
    place_of,
    place_w,
    watch_places,
    way_between,
)
from perception.values import Float

ARC_SPEED_MPS = 5.0
#: A place is watched from for so long; what was seen holds until the rotor is measured.
STILL_S, STILL_KEPT_S = 15.0, 90.0
SIDE_LOST_S = 10.0
PLACE_WITHIN_M = 4.0
#: The way in ends this far before the hub.
NEAREST_M = 15.0
#: Left to the ground, and to the height limit.
ROOM_M = 15.0
#: A goal that moves by more than this is flown to anew.
MOVED_M = 2.5
#: So near the closed sphere the way round it is planned anew, from there, this often at most.
SPARE_M, PLANNED_AGAIN_S = 0.7, 3.0


class SideSearch(PhaseStep, Protocol):
    """The phase that finds out on which side of its tower the rotor hangs."""

    def look_again(self, flight: Flight, /) -> bool:
        """Begin to look for it again from here; False: there is no way to."""
        ...


class Approach:
    """Arrive in front outside the sphere, make sure that the rotor stands still, go in."""

    phase = Phase.APPROACH

    def __init__(self, search: SideSearch) -> None:
        """``search``: where looks contradict each other on the way round, it is gone back to."""
        self._search = search
        self._inward = False
        self._moving = False
        self._waiting_s: float | None = None
        self._places: list[WatchPlace] = []
        """Still to be watched from; the first is flown to, or at."""
        self._planned_s = -math.inf
        self._still_s: float | None = None
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
        if normal is None and not self._inward and self._search.look_again(flight):
            words = "looking for the side of the rotor again"
            return Intent(words, setpoint=flight.hold(), then=self._search)
        if normal is None:
            words = "the side of the rotor is not known any more"
            return leave(flight, Intent(words, flight.hold()), MissionState.REFUSED, words)
        self._lost_s = None
        hub = flight.hub_w
        yaw, gimbal = flight.yaw_to(hub), flight.aim_at(hub)
        if not self._inward:
            return self._round(flight, hub, normal, yaw)
        goal = before_hub(hub, normal, flight.settings.estimation.stand_off_m)
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
        """Fly to where the rotor is watched from, watch; in the end be before it."""
        flight.sense(SensingMode.TOWER)
        front, radius = bearing_rad(np.zeros(3), -normal), flight.clear_radius_m
        if not self._places:
            self._places = list(_places(flight, hub, front))
        place = self._places[0]
        if not self._moving:
            here = place_of(hub, front, flight.here_w)
            way = way_between(hub, radius, front, here, place)
            self._moving, self._goal, self._planned_s = True, way[-1], flight.now_s
            flight.go(way, ARC_SPEED_MPS)
        wanted = place_w(hub, radius, front, place)
        if self._goal is not None and np.hypot(*(wanted - self._goal)[:2]) > PLACE_WITHIN_M:
            self._moving = False
        if self._too_near(flight, hub):
            self._moving = False
        setpoint, gimbal = flight.follow(yaw), flight.aim_at(hub)
        if not flight.arrived(1.5):
            words = "flying round to " + _words(place)
            return Intent(words, setpoint=setpoint, gimbal=gimbal)
        prior = flight.observation.hub_prior
        if prior is not None and prior.turning is False:
            self._still_s = flight.now_s
        if self._still_s is not None and flight.now_s - self._still_s < STILL_KEPT_S:
            return self._still(flight, hub, normal, Intent("", setpoint=setpoint, gimbal=gimbal))
        return self._watch(flight, Intent("", setpoint=setpoint, gimbal=gimbal))

    def _too_near(self, flight: Flight, hub: Float) -> bool:
        """Return whether hub or position have drifted so that the way leads into the sphere."""
        apart_m = float(np.linalg.norm(flight.here_w - hub))
        return (
            apart_m < flight.sphere_radius_m + SPARE_M
            and flight.now_s - self._planned_s > PLANNED_AGAIN_S
        )

    def _still(self, flight: Flight, hub: Float, normal: Float, here: Intent) -> Intent:
        """Go in from the front; from beside the rotor, there first."""
        if self._places[0] != FRONT:
            self._next([FRONT])
            return replace(here, words="the rotor stands still")
        flight.rotor_open = True
        front = bearing_rad(np.zeros(3), -normal)
        before = place_w(hub, flight.clear_radius_m, front, FRONT)
        flight.open_corridor([np.stack([before, before_hub(hub, normal, NEAREST_M)])])
        self._inward, self._moving = True, False
        return replace(here, words="the rotor stands still")

    def _watch(self, flight: Flight, here: Intent) -> Intent:
        """Wait here for a while; then watch from the next place, or give up."""
        if self._waiting_s is None:
            self._waiting_s = flight.now_s
        if flight.now_s - self._waiting_s <= STILL_S:
            return replace(here, words="watching whether the rotor turns")
        if len(self._places) > 1:
            self._next(self._places[1:])
            return replace(here, words="looking for a better view of the blades")
        words = "it could not be told whether the rotor stands still"
        return leave(flight, replace(here, words=words), MissionState.REFUSED, words)

    def _next(self, places: list[WatchPlace]) -> None:
        self._places = places
        self._moving, self._waiting_s = False, None


def _places(flight: Flight, hub: Float, front: float) -> tuple[WatchPlace, ...]:
    """Return where this rotor is watched from."""
    settings, level = flight.settings, float(hub[2])
    home_m = 0.0 if flight.home_w is None else flight.home_w[2]
    below = level - max(flight.ground_m, home_m) - ROOM_M
    above = home_m + settings.guard.max_height_m - level - ROOM_M
    here = bearing_rad(hub, flight.here_w)
    return watch_places(
        here, front, flight.clear_radius_m, settings.lidar.max_range_m, (below, above)
    )


def _words(place: WatchPlace) -> str:
    return "the front of the rotor" if place == FRONT else "where a tip of the rotor is near"
