"""How much energy flying takes, and whether enough is left to fly home.

Power = hover + parasitic drag at airspeed cubed + climb. It is a planning model: pure numbers,
no state; the autopilot's own measure of the battery stays the truth in flight.
"""

from __future__ import annotations

import math

from config.airframe import Airframe, Battery

Vec3 = tuple[float, float, float]

_STILL_AIR: Vec3 = (0.0, 0.0, 0.0)


def power_w(battery: Battery, velocity_mps: Vec3, wind_mps: Vec3 = _STILL_AIR) -> float:
    """Return the electrical power drawn while moving.

    ``velocity_mps``: over ground, ENU; ``wind_mps``: the air's own velocity over ground, ENU.
    Descent is charged as level flight: what a multirotor saves in it is not relied upon.
    """
    airspeed_mps = math.dist(velocity_mps, wind_mps)
    climb_mps = max(velocity_mps[2], 0.0)
    return (
        battery.hover_w
        + battery.drag_w_per_mps3 * airspeed_mps**3
        + battery.climb_w_per_mps * climb_mps
    )


def hover_s(battery: Battery, charge: float = 1.0, wind_mps: Vec3 = _STILL_AIR) -> float:
    """Return how long the vehicle can hover from ``charge`` (0-1) down to the reserve."""
    usable_wh = max(charge - battery.reserve, 0.0) * battery.capacity_wh
    return 3600.0 * usable_wh / power_w(battery, _STILL_AIR, wind_mps)


def leg_s(airframe: Airframe, start_m: Vec3, end_m: Vec3, speed_mps: float) -> float:
    """Return the time for a straight leg at ``speed_mps``, within the vehicle's vertical limits.

    Positions are ENU metres. Starting and stopping are charged with ``speed / acceleration``.
    """
    distance_m = math.dist(start_m, end_m)
    if distance_m < 1e-3:
        return 0.0
    rise_m = end_m[2] - start_m[2]
    vertical_mps = airframe.max_climb_mps if rise_m > 0 else airframe.max_descent_mps
    cruise_s = max(distance_m / speed_mps, abs(rise_m) / vertical_mps)
    return cruise_s + (distance_m / cruise_s) / airframe.max_acceleration_mps2


def leg_wh(
    battery: Battery,
    airframe: Airframe,
    start_m: Vec3,
    end_m: Vec3,
    speed_mps: float,
    wind_mps: Vec3 = _STILL_AIR,
) -> float:
    """Return the energy of a straight leg in steady wind (arguments as in `leg_s`)."""
    duration_s = leg_s(airframe, start_m, end_m, speed_mps)
    if duration_s == 0.0:
        return 0.0
    velocity: Vec3 = (
        (end_m[0] - start_m[0]) / duration_s,
        (end_m[1] - start_m[1]) / duration_s,
        (end_m[2] - start_m[2]) / duration_s,
    )
    return power_w(battery, velocity, wind_mps) * duration_s / 3600.0


def share_home(
    battery: Battery,
    airframe: Airframe,
    position_m: Vec3,
    home_m: Vec3,
    transit_height_m: float,
    wind_mps: Vec3 = _STILL_AIR,
) -> float:
    """Return the share of the capacity that flying home and landing takes, without the reserve.

    The way is the one flown: up to ``transit_height_m`` where the vehicle is below it (clear of
    the rotor's tips), level to over home at the vehicle's full speed, down to the ground.
    """
    level_m = max(position_m[2], transit_height_m)
    above_m: Vec3 = (position_m[0], position_m[1], level_m)
    over_home_m: Vec3 = (home_m[0], home_m[1], level_m)
    legs = ((position_m, above_m), (above_m, over_home_m), (over_home_m, home_m))
    energy_wh = sum(
        leg_wh(battery, airframe, start, end, airframe.max_speed_mps, wind_mps)
        for start, end in legs
    )
    return energy_wh / battery.capacity_wh


def must_return_at(
    battery: Battery,
    airframe: Airframe,
    position_m: Vec3,
    home_m: Vec3,
    transit_height_m: float,
    wind_mps: Vec3 = _STILL_AIR,
) -> float:
    """Return the charge (0-1) at which the way home has to begin, to land with the reserve.

    Never below 0.05 above the autopilot's own low-battery return, so that ours comes first.
    """
    home = share_home(battery, airframe, position_m, home_m, transit_height_m, wind_mps)
    return max(battery.reserve + home, battery.autopilot_return_at + 0.05)
