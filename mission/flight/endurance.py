"""Does the battery suffice for one more pass, and for the way home after it?

Predicted before each pass: the way to it, the pass, and from its end the way home with the reserve.
An inspection that needs more than a battery is so split between passes, not within them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from config.energy import leg_s, must_return_at, power_w
from mission.flight.flight import Flight
from mission.flight.footprint import tracking_speed_mps
from mission.flight.leg import Leg
from mission.flight.motion import shutter_s
from perception.geometry import vec3

#: What the watch keeps above the charge at which the way home has to begin.
WATCHED = 0.02
#: A way round the rotor is so much longer than the straight line.
DETOUR = 1.3
#: What a pass takes longer than planned, in gusts and by photos that wait for a better moment.
SLOWER = 1.15
#: Braking, aiming and the photos' own waits at a pass's ends.
ENDS_S = 4.0


def suffices(flight: Flight, leg: Leg, photos: Sequence[float]) -> bool:
    """Return whether a pass over these metres may begin; unknown charge is left to the watch."""
    vehicle, settings = flight.vehicle, flight.settings
    if vehicle.battery is None:
        return True
    first, last = leg.position(photos[0]), leg.position(photos[-1])
    wind = vehicle.wind_w or (0.0, 0.0, 0.0)
    near_mps = settings.guard.max_speed_near_mps
    apart_s = leg_s(settings.airframe, vec3(flight.here_w), vec3(first), near_mps)
    shutter = shutter_s(flight.observation.camera, settings)
    pace = tracking_speed_mps(leg.distance_at(photos[0]), leg.spacing_m, shutter, settings)
    along_s = SLOWER * abs(photos[-1] - photos[0]) / pace + ENDS_S
    battery = settings.battery
    drawn_w = power_w(battery, (pace, 0.0, 0.0), (0.0, math.hypot(wind[0], wind[1]), 0.0))
    used = drawn_w * (DETOUR * apart_s + along_s) / 3600.0 / battery.capacity_wh
    home = flight.goal_w
    needed = must_return_at(battery, settings.airframe, vec3(last), home, float(last[2]), wind)
    return vehicle.battery - used >= needed + WATCHED
