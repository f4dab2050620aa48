"""Ways outside the closed sphere: up along it, and round the turbine. World ENU, metres."""

from __future__ import annotations

import math

import numpy as np

from perception.geometry import wrap_angle
from perception.values import Float

ARC_STEP_RAD = math.radians(5.0)
#: A rotor is looked at from so much below its hub, of the distance before it.
BELOW_SHARE = 0.12


def bearing_rad(from_w: Float, to_w: Float) -> float:
    """Return the ENU direction (radians) of the horizontal line between two points (3,)."""
    return math.atan2(float(to_w[1] - from_w[1]), float(to_w[0] - from_w[0]))


def at_bearing(centre_w: Float, bearing: float, radius_m: float, height_m: float) -> Float:
    """Return the point (3,) at a bearing and horizontal radius from a centre, at a height z."""
    x = centre_w[0] + radius_m * math.cos(bearing)
    y = centre_w[1] + radius_m * math.sin(bearing)
    return np.array([x, y, height_m])


def arc(
    centre_w: Float, radius_m: float, from_rad: float, to_rad: float, from_m: float, to_m: float
) -> Float:
    """Return points (K, 3) on the shorter arc round a centre, the height going from..to."""
    turn = wrap_angle(to_rad - from_rad)
    count = max(2, math.ceil(abs(turn) / ARC_STEP_RAD) + 1)
    share = np.linspace(0.0, 1.0, count)
    return np.stack(
        [
            at_bearing(centre_w, from_rad + s * turn, radius_m, from_m + s * (to_m - from_m))
            for s in share
        ]
    )


def before_hub(hub_w: Float, normal_w: Float, distance_m: float) -> Float:
    """Return the place (3,) from which a rotor is looked at: before the hub, a little below it.

    On the rotor's axis one would hang above it, for rotors are tilted up; but the LiDAR sees less
    below its own height than above, and beside itself least: of blades that hang aside it would
    see the roots alone. ``normal_w``: (3,) downwind.
    """
    east, north = normal_w[0], normal_w[1]
    level = np.array([east, north, 0.0]) / math.hypot(east, north)
    below = np.array([0.0, 0.0, BELOW_SHARE])
    return np.asarray(hub_w - distance_m * (level + below), np.float64)


def up_the_sphere(
    hub_w: Float, radius_m: float, bearing: float, distance_m: float, height_m: float
) -> Float:
    """Return points (K, 3) that climb beside the sphere to the hub's height.

    From a horizontal distance and a height below the hub: straight up until the sphere of this
    radius is met, then along its meridian out to its equator.
    """
    drop = math.sqrt(max(radius_m**2 - min(distance_m, radius_m) ** 2, 0.0))
    below = max(0.0, float(hub_w[2]) - height_m)
    points = []
    if distance_m >= radius_m:
        return at_bearing(hub_w, bearing, distance_m, float(hub_w[2]))[None]
    if below > drop:
        points.append(at_bearing(hub_w, bearing, distance_m, float(hub_w[2]) - drop))
    start = math.acos(min(1.0, distance_m / radius_m))
    for angle in np.linspace(start, 0.0, max(2, math.ceil(start / ARC_STEP_RAD) + 1)):
        out, down = radius_m * math.cos(angle), radius_m * math.sin(angle)
        points.append(at_bearing(hub_w, bearing, out, float(hub_w[2]) - down))
    return np.stack(points)


def distance_at_height(radius_m: float, below_hub_m: float, wanted_m: float) -> float:
    """Return the horizontal distance, at least the wanted one, outside the sphere at a height."""
    return max(wanted_m, math.sqrt(max(0.0, radius_m**2 - below_hub_m**2)))
