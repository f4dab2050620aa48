"""One rotor of the estimates that agree.

Successive looks err partly by themselves: position, attitude and sway differ from look to look. So
what a flight goes by is the mean of the looks that agreed, not the last of them. Their errors are
partly common (mounting, the blade's unknown shape), so the sigma stays that of one look.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mission.flight.observation import BladeEstimate, RotorEstimate, Vec3
from perception.geometry import stop_angle_difference_deg, vec3
from perception.values import Float

#: So many estimates are settled where their mean is known to this (one standard deviation).
SETTLED_COUNT, SETTLED_DEG = 8, 0.25
#: A slope of the angle over the estimates by so many of its standard deviations is a turn, if it is
#: more than what roots seen from a drifting place show.
TREND_SIGMAS, LEAST_TREND_DPS = 2.5, 0.02


def agreed_rotor(estimates: Sequence[RotorEstimate]) -> RotorEstimate:
    """Return the mean rotor of estimates that agree; stamp and sequence are those of the last.

    Hub, normal and the blades' directions are means; the stop angle is the mean on the circle of
    120 deg. Names and pitches are those of the estimate nearest to the mean: near 75 deg two looks
    may name the blades differently.
    """
    last = estimates[-1]
    offset = float(np.mean([_off(one, last) for one in estimates]))
    base = min(reversed(estimates), key=lambda one: abs(_off(one, last) - offset))
    angle = (last.stop_angle_deg + offset) % 120.0
    return replace(
        base,
        stamp_s=last.stamp_s,
        sequence=last.sequence,
        hub_w=vec3(np.mean([one.hub_w for one in estimates], axis=0)),
        normal_w=vec3(_unit(np.mean([one.normal_w for one in estimates], axis=0))),
        stop_angle_deg=0.0 if angle >= 120.0 else angle,
        blades=tuple(
            replace(blade, direction_w=_mean_direction(blade, estimates)) for blade in base.blades
        ),
    )


def settled(estimates: Sequence[RotorEstimate]) -> bool:
    """Return whether estimates that scatter are many enough for their mean to be known.

    Without RTK each look errs by itself, by half a degree and more of a large rotor. Those of a
    rotor that turns do not scatter, they follow one another: a trend is not settled.
    """
    count = len(estimates)
    if count < SETTLED_COUNT:
        return False
    off = np.array([_off(one, estimates[-1]) for one in estimates])
    off = off - np.median(off)
    time_s = np.array([one.stamp_s for one in estimates])
    time_s = time_s - time_s.mean()
    spread_s = float(np.sqrt(time_s @ time_s))
    rate = float(time_s @ off) / max(spread_s, 1e-6) ** 2
    sigma = float(np.std(off - rate * time_s, ddof=2))
    still = abs(rate) < max(TREND_SIGMAS * sigma / max(spread_s, 1e-6), LEAST_TREND_DPS)
    return still and sigma / math.sqrt(count) < SETTLED_DEG


def same_blade(blade: BladeEstimate, estimate: RotorEstimate) -> BladeEstimate:
    """Return the blade of another estimate that points where this one does."""
    return max(estimate.blades, key=lambda b: float(np.dot(b.direction_w, blade.direction_w)))


def _off(one: RotorEstimate, last: RotorEstimate) -> float:
    return stop_angle_difference_deg(one.stop_angle_deg, last.stop_angle_deg)


def _mean_direction(blade: BladeEstimate, estimates: Sequence[RotorEstimate]) -> Vec3:
    directions = [same_blade(blade, one).direction_w for one in estimates]
    return vec3(_unit(np.mean(directions, axis=0)))


def _unit(value: Float) -> Float:
    return np.asarray(value / np.linalg.norm(value), np.float64)
