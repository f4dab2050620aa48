"""A hovering vehicle is taken over: out of the rotor first, then everything as from the ground.

Where an earlier flight was lost in the air, and the autopilot still counts from the same place,
the rotor as it was last measured says which way is out; it is forgotten as soon as the vehicle is
outside, for it must be found and measured again.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mission.flight.command import Phase
from mission.flight.earlier import Standing
from mission.flight.flight import Flight, Intent
from mission.flight.observation import BladeEstimate, RotorEstimate, Vehicle
from mission.flight.phases.ascend import Ascend
from mission.flight.phases.leave import StandOff
from mission.flight.phases.takeoff import Engage
from mission.flight.rotor_model import MeasuredBlade, rotor_model

#: Two tellings of where the autopilot counts from differ by less, by its own noise.
SAME_FRAME_M = 6.0
METRES_PER_DEG = 111_320.0


def take_over(flight: Flight) -> Intent:
    """Begin to fly a vehicle that hovers; what is known of the rotor is recalled."""
    vehicle, request = flight.vehicle, flight.request
    flight.home_w = vehicle.home_w or vehicle.position_w
    first = request is None or request.flight == 1
    if first:
        asked = None if request is None else request.rendezvous_w
        home = flight.home_w
        flight.rendezvous_w = vehicle.position_w
        if asked is not None:
            flight.rendezvous_w = home[0] + asked[0], home[1] + asked[1], home[2] + asked[2]
    standing = None if flight.earlier is None else flight.earlier.standing
    if standing is not None and same_frame(standing, vehicle):
        recall(flight, standing)
        flight.note("takeover", "the rotor is where the last flight measured it: leaving it first")
    then = StandOff(Afresh())
    return Intent("taking over in the air", then=Engage(then, vehicle.mode, taken_over=True))


def same_frame(standing: Standing, vehicle: Vehicle) -> bool:
    """Return whether the autopilot still counts from where it did: the same place on the globe."""
    latitude, longitude = vehicle.latitude_deg, vehicle.longitude_deg
    if latitude is None or longitude is None:
        return False
    north = (latitude - standing.latitude_deg) * METRES_PER_DEG
    east = (longitude - standing.longitude_deg) * METRES_PER_DEG * math.cos(math.radians(latitude))
    expected = standing.position_w[0] + east, standing.position_w[1] + north
    return math.dist(expected, vehicle.position_w[:2]) < SAME_FRAME_M


def recall(flight: Flight, standing: Standing) -> None:
    """Take the rotor as it was last measured for where it is."""
    blades = standing.blades
    flight.rotor = RotorEstimate(
        stamp_s=flight.now_s,
        sequence=-1,
        hub_w=standing.hub_w,
        normal_w=standing.normal_w,
        blades=tuple(BladeEstimate(name, axis, pitch) for name, axis, pitch in blades),
        method="recalled",
    )
    flight.model = rotor_model(
        np.array(standing.hub_w),
        np.array(standing.normal_w),
        [MeasuredBlade(name, axis, pitch) for name, axis, pitch in blades],
        flight.turbine,
        np.array(standing.tower_w),
        np.array([0.0, 0.0, 1.0]),
    )
    flight.rotor_open = True


class Afresh:
    """Forget what was recalled, once outside, and look for the turbine as after a take-off."""

    phase = Phase.ASCEND

    def resume(self, _flight: Flight) -> None:
        """Nothing is under way yet."""

    def step(self, flight: Flight) -> Intent:
        """Close the sphere and begin the ascent from here."""
        flight.rotor_open = False
        flight.rotor = flight.model = flight.plan = None
        flight.open_corridor([])
        intent = Intent("looking for the turbine", setpoint=flight.hold())
        return replace(intent, then=Ascend())
