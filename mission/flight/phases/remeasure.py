"""Measuring again: the rotor is forgotten, once outside, and approached anew."""

from __future__ import annotations

import numpy as np

from mission.flight.command import Phase
from mission.flight.flight import Flight, Intent
from mission.flight.phases.approach import Approach
from mission.flight.phases.ascend import Ascend


class Remeasure:
    """Forget the measured rotor, once outside, and approach it anew."""

    phase = Phase.APPROACH

    def resume(self, _flight: Flight) -> None:
        """Nothing is under way yet."""

    def step(self, flight: Flight) -> Intent:
        """Close the sphere and begin the approach."""
        flight.rotor_open = False
        flight.rotor = flight.model = flight.plan = None
        flight.leg_index, flight.drift_w = 0, np.zeros(3)
        flight.open_corridor([])
        return Intent("measuring the rotor again", setpoint=flight.hold(), then=Approach(Ascend()))
