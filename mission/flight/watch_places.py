"""From where outside the closed sphere it is seen whether the rotor stands still.

Before the hub of a large rotor, outside the sphere, every blade is farther away than the LiDAR
sees: the hub is a radius and more away, the tips half as far again. A tip is near where one looks
from beside: a quarter of a right angle before the rotor's plane, and within 20 deg of the blade.
One of three blades points, within these, to one of three places on the same side: level with the
hub, below and above.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mission.flight.around import arc, at_bearing, bearing_rad
from perception.geometry import wrap_angle
from perception.values import Float

#: From before the rotor to beside it; and how far the places below and above lie from the hub's
#: height, seen from the hub.
BESIDE_RAD, RAISED_RAD = math.radians(65.0), math.radians(38.0)
LEAST_RAISED_RAD = math.radians(10.0)
#: Share of the LiDAR's range over which it shows enough of a blade.
SEEN_SHARE = 0.9
STEP_RAD = math.radians(5.0)


@dataclass(frozen=True, slots=True)
class WatchPlace:
    """A place on the sphere round the hub."""

    turn_rad: float = 0.0
    """From before the rotor, counter-clockwise seen from above."""
    raised_rad: float = 0.0
    """Above the hub's height, seen from the hub."""


FRONT = WatchPlace()


def watch_places(
    here_rad: float, front_rad: float, radius_m: float, range_m: float, room_m: tuple[float, float]
) -> tuple[WatchPlace, ...]:
    """Return the places to watch from, in their order.

    ``here_rad``: bearing from the hub on which the vehicle is; ``radius_m``: of the sphere's
    surface; ``range_m``: of the LiDAR; ``room_m``: to fly in, below and above the hub's height.
    """
    side = math.copysign(BESIDE_RAD, wrap_angle(here_rad - front_rad))
    wanted = radius_m * math.sin(RAISED_RAD)
    raised = [0.0]
    for sign, room in zip((-1.0, 1.0), room_m, strict=True):
        angle = math.asin(min(wanted, max(room, 0.0)) / radius_m)
        if angle >= LEAST_RAISED_RAD:
            raised.append(sign * angle)
    beside = [WatchPlace(side, angle) for angle in raised]
    near = radius_m < SEEN_SHARE * range_m
    return (FRONT, *beside) if near else (*beside, FRONT)


def way_between(
    hub_w: Float, radius_m: float, front_rad: float, start: WatchPlace, end: WatchPlace
) -> Float:
    """Return points (K, 3) over the sphere's surface from one place to another.

    Along the meridian where both lie on one, else over the hub's height.
    """
    here, there = front_rad + start.turn_rad, front_rad + end.turn_rad
    if start.turn_rad == end.turn_rad:
        return _meridian(hub_w, radius_m, there, start.raised_rad, end.raised_rad)
    level = float(hub_w[2])
    parts = [arc(hub_w, radius_m, here, there, level, level)]
    if start.raised_rad:
        parts.insert(0, _meridian(hub_w, radius_m, here, start.raised_rad, 0.0))
    if end.raised_rad:
        parts.append(_meridian(hub_w, radius_m, there, 0.0, end.raised_rad))
    return np.concatenate(parts)


def place_w(hub_w: Float, radius_m: float, front_rad: float, place: WatchPlace) -> Float:
    """Return where (3,) a place is."""
    at = _meridian(hub_w, radius_m, front_rad + place.turn_rad, place.raised_rad, place.raised_rad)
    return np.asarray(at[0], np.float64)


def place_of(hub_w: Float, front_rad: float, here_w: Float) -> WatchPlace:
    """Return the place on the sphere that a vehicle (3,) is beside, within or without."""
    level_m = math.hypot(here_w[0] - hub_w[0], here_w[1] - hub_w[1])
    turn = wrap_angle(bearing_rad(hub_w, here_w) - front_rad)
    return WatchPlace(turn, math.atan2(float(here_w[2] - hub_w[2]), level_m))


def _meridian(
    hub_w: Float, radius_m: float, bearing: float, start_rad: float, end_rad: float
) -> Float:
    count = max(2, math.ceil(abs(end_rad - start_rad) / STEP_RAD) + 1)
    return np.stack(
        [
            at_bearing(
                hub_w, bearing, radius_m * math.cos(angle),
                float(hub_w[2]) + radius_m * math.sin(angle),
            )
            for angle in np.linspace(start_rad, end_rad, count)
        ]
    )  # fmt: skip
