"""The plan as it is told on the bus: each line to be flown, in its order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mission.flight.observation import Vec3
from mission.remote.messages import Message
from perception.geometry import vec3

if TYPE_CHECKING:
    # Who reads plans does not make them: the solver behind them takes a while to import.
    from mission.flight.leg import Leg
    from mission.flight.plan import Plan

#: A leg is nearly straight: blades bend by a few metres over their length.
STEP_M = 4.0


class LegMessage(Message):
    """One line along a blade."""

    blade: str
    side: str
    line_w: tuple[Vec3, ...]
    """Where the vehicle flies, from the first photo to the last; the flight's frame."""
    photos_m: tuple[float, ...]
    """The metres photographed, in the order flown."""
    blind: bool = False
    """The LiDAR does not see the blade from here."""


class PlanMessage(Message):
    """Flight to recorder, when a plan was made: what will be flown."""

    legs: tuple[LegMessage, ...]


def told(plan: Plan) -> PlanMessage:
    """Return a plan as it is told."""
    return PlanMessage(legs=tuple(_leg(leg) for leg in plan.legs))


def _leg(leg: Leg) -> LegMessage:
    first, last = leg.photos[0], leg.photos[-1]
    count = 2 + int(abs(last - first) / STEP_M)
    return LegMessage(
        blade=leg.blade,
        side=leg.side,
        line_w=tuple(vec3(leg.position(float(m))) for m in np.linspace(first, last, count)),
        photos_m=leg.photos,
        blind=leg.blind,
    )
