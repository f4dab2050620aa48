"""Ascend: find the tower low, climb beside the closed sphere, learn which way the rotor faces.

Low, where the sphere leaves room, the vehicle goes near enough to see the tower well. Then it
climbs along the sphere to the hub's height, always facing the tower, while sensing looks for the
tower's axis and top, the rotor's side and whether it turns. Where the side stays unknown it
circles the tower outside the sphere.
"""

from __future__ import annotations

import math

import numpy as np

from mission.flight.around import (
    arc,
    at_bearing,
    bearing_rad,
    distance_at_height,
    up_the_sphere,
)
from mission.flight.command import MissionState, Phase, SensingMode
from mission.flight.flight import Flight, Intent
from mission.flight.phases.approach import Approach
from mission.flight.phases.leave import leave
from perception.values import Float

SURVEY_HEIGHT_M = 15.0
SURVEY_DISTANCE_M = 35.0
LOOK_S = 6.0
KNOWN_S = 3.0
SIDE_S = 3.0
#: A tower or hub found this far from where it was believed moves the path.
MOVED_M = 1.5
ARC_SPEED_MPS = 5.0
#: So near the hub's height it is circled at once.
LEVEL_M = 5.0
CIRCLE_STEP_RAD = math.radians(30.0)


class Ascend:
    """Survey low, climb, circle if need be; ends when the prior hub and its side are known."""

    phase = Phase.ASCEND

    def __init__(self) -> None:
        self._stage = "survey"
        self._moving = False
        self._arrived_s: float | None = None
        self._known_s: float | None = None
        self._looked = 0
        self._circled = 0
        self._hub: np.ndarray[tuple[int, ...], np.dtype[np.float64]] | None = None

    def resume(self, _flight: Flight) -> None:
        """Work the way out again from here."""
        self._moving = False

    def step(self, flight: Flight) -> Intent:
        """Fly the stage, look while flying."""
        flight.sense(SensingMode.TOWER)
        tower = flight.tower_w
        hub = flight.hub_w
        # The closed sphere moves with the hub: what was a way beside it may now lie inside.
        if self._hub is not None and np.linalg.norm(hub - self._hub) > MOVED_M:
            self._moving = False
        if not self._moving:
            self._hub, self._moving, self._arrived_s = hub, True, None
            self._start(flight)
        yaw = flight.yaw_to(tower)
        if self._stage == "survey" and self._well_known(flight):
            return self._next("climb", Intent("the tower is found", setpoint=flight.hold(yaw)))
        setpoint = flight.follow(yaw)
        gimbal = flight.aim_at(np.array([tower[0], tower[1], flight.here_w[2]]))
        words = {
            "survey": "looking for the tower",
            "climb": "climbing beside the tower",
            "circle": "circling to see which way the rotor faces",
        }[self._stage]
        if not flight.arrived():
            return Intent(words, setpoint=setpoint, gimbal=gimbal)
        if self._arrived_s is None:
            self._arrived_s = flight.now_s
        hold = Intent(words, setpoint=flight.follow(yaw), gimbal=gimbal)
        return self._decide(flight, flight.now_s - self._arrived_s, hold)

    def look_again(self, flight: Flight) -> bool:
        """Circle on, from outside the sphere; from above the hub there is no way down known."""
        above_m = float(flight.here_w[2] - flight.hub_w[2])
        self._stage, self._moving = "climb" if above_m < -LEVEL_M else "circle", False
        return above_m < LEVEL_M

    def _well_known(self, flight: Flight) -> bool:
        """Return whether the tower was seen where it is for a while: no need to go nearer."""
        if not flight.tower_known:
            self._known_s = None
            return False
        if self._known_s is None:
            self._known_s = flight.now_s
        return flight.now_s - self._known_s > KNOWN_S

    def _start(self, flight: Flight) -> None:
        hub, radius, here = flight.hub_w, flight.clear_radius_m, flight.here_w
        bearing = bearing_rad(hub, here)
        speed = flight.settings.airframe.max_speed_mps
        climb = min(flight.settings.ascent.climb_speed_mps, speed)
        home_z = 0.0 if flight.home_w is None else flight.home_w[2]
        if self._stage == "survey":
            height = max(home_z + SURVEY_HEIGHT_M, min(float(here[2]), float(hub[2])))
            below = float(hub[2]) - height
            distance = distance_at_height(radius, below, SURVEY_DISTANCE_M)
            turned = bearing + (0.0, 0.6, -0.6)[min(self._looked, 2)]
            first = np.array([here[0], here[1], height])[None]
            if here[2] > height:
                # Taken over above the hub, whence no tower is seen: out, and down by the sphere.
                out_m = max(radius, math.dist(here[:2], hub[:2]))
                first = _down(hub, bearing, out_m, here, height)
            last_w = at_bearing(hub, turned, distance, height)
            flight.go(np.concatenate([first, last_w[None]]), speed)
        elif self._stage == "climb":
            # Beyond the sphere's equator the LiDAR sees too little: come in while climbing.
            distance = math.hypot(here[0] - hub[0], here[1] - hub[1])
            outside = distance_at_height(radius, float(hub[2] - here[2]), min(distance, radius))
            way = up_the_sphere(hub, radius, bearing, outside, float(here[2]))
            if abs(outside - distance) > 0.5:
                out = at_bearing(hub, bearing, outside, float(here[2]))
                way = np.concatenate([out[None], way])
            flight.go(way, max(climb, 1.0) + 1.0)
        else:
            goal = bearing + CIRCLE_STEP_RAD
            height = float(hub[2])
            flight.go(arc(hub, radius, bearing, goal, height, height), ARC_SPEED_MPS)

    def _decide(self, flight: Flight, waited_s: float, hold: Intent) -> Intent:
        if self._stage == "survey":
            if flight.tower_known:
                return self._next("climb", hold)
            if waited_s < LOOK_S:
                return hold
            self._looked += 1
            if self._looked > 2:
                words = "no tower was found where it was told"
                return leave(flight, hold, MissionState.REFUSED, words)
            return self._next("survey", hold)
        prior = flight.observation.hub_prior
        if prior is not None and prior.normal_w is not None:
            flight.note("prior_hub", f"rotor side known, sigma {prior.sigma_m:.1f} m")
            return Intent(hold.words, hold.setpoint, gimbal=hold.gimbal, then=Approach(self))
        if waited_s < SIDE_S:
            return hold
        self._circled += 1
        if self._circled > round(2 * math.pi / CIRCLE_STEP_RAD):
            words = "the side of the rotor stayed unknown all round the tower"
            return leave(flight, hold, MissionState.REFUSED, words)
        return self._next("circle", hold)

    def _next(self, stage: str, hold: Intent) -> Intent:
        self._stage, self._moving = stage, False
        return hold


def _down(hub: Float, bearing: float, out_m: float, here: Float, height_m: float) -> Float:
    """Return points (2, 3): at this horizontal distance from the hub, as high as now, and below."""
    heights = (float(here[2]), height_m)
    return np.stack([at_bearing(hub, bearing, out_m, height) for height in heights])
