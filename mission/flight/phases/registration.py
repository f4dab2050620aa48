"""Registration: the plan is moved to where the LiDAR sees the blade.

The vehicle's position drifts, blades droop and bend: the measured axis lies beside the modelled
one. The plan follows that offset by a low-pass, and, where the surface comes nearer than it
should, moves outward. An offset that no drift explains means that the rotor has moved.
"""

from __future__ import annotations

import math

import numpy as np

from mission.flight.flight import Flight
from mission.flight.passes import Leg
from perception.values import Float

#: Low-pass of the offset that the path follows: what the position's noise does in a second or two
#: is undone by the LiDAR, so that the distance is held to the blade and not to the position.
TIME_S = 0.5
#: And of the one that the camera is aimed by, which need not be smooth.
AIM_TIME_S = 0.35
FRESH_S = 0.5
#: A position without corrections drifts by metres between two measurements of the rotor.
MOST_M = 6.0
LEARN_S = 2.0
NO_DROOP_SHARE = 0.4
#: How far off the drift along a blade may be by the errors of the fitted rotor.
DOUBT_M = 0.7
#: Beyond drift and droop: the droop grows with the metre, the drift since the rotor was measured.
MOVED_M = 3.0
MOVED_PER_METRE = 0.03
DRIFTED_M, DRIFTED_S = 3.0, 120.0
#: A blade does not jump: an offset that does is something else's, or found again after a loss.
JUMP_M = 1.5
#: Unless it stays: then it is what the sensor sees now.
JUMP_STAYS_S = 3.0
LOST_S = 5.0
PUSH_MPS = 0.4
MOST_PUSH_M = 4.0


class Registration:
    """The shift (3,) of the plan for the blade that is flown."""

    def __init__(self) -> None:
        self.shift_w: Float = np.zeros(3)
        self.moved_s = 0.0
        """How long the offset has been one that only a moved rotor explains."""
        self.aim_w: Float = np.zeros(3)
        """The same for the camera: less smooth, and where the blade was seen last."""
        self._drift: Float = np.zeros(3)
        self._seen: Float = np.zeros(3)
        self._position: Float = np.zeros(3)
        """(3,) the position's drift since the rotor was measured, as far as blades have shown."""
        self._push = 0.0
        self._stamp_s = -math.inf
        self._blade = ""
        self._begun = False
        self._jumped_s = 0.0
        self._leapt = False

    def begin(self, blade: str) -> None:
        """Begin a leg. What was learnt on another blade is a first guess: the position's drift."""
        if blade != self._blade:
            # Without the other blade's droop.
            self._drift = self._seen = self._position
            self._begun = False
        self._jumped_s, self._leapt = 0.0, False
        self._blade, self._push, self.moved_s = blade, 0.0, 0.0
        self.shift_w = self._drift

    def fresh(self, flight: Flight, leg: Leg) -> bool:
        """Return whether the newest track is of this blade, recent, and measured."""
        track = flight.observation.blade
        return (
            track is not None
            and track.blade == leg.blade
            and not track.from_model
            and flight.now_s - track.stamp_s < FRESH_S
        )

    def update(self, flight: Flight, leg: Leg) -> Float:
        """Take the newest track and clearance; return the shift."""
        track = flight.observation.blade
        if track is not None and self.fresh(flight, leg) and track.stamp_s > self._stamp_s:
            if track.stamp_s - self._stamp_s > LOST_S:
                # Not seen for a while: what drifted meanwhile has not leapt.
                self._begun = False
            step_s = min(track.stamp_s - self._stamp_s, 0.3)
            self._stamp_s = track.stamp_s
            # What of the offset is the blade's own form is in the plan.
            offset = np.array(track.offset_w) - leg.centre(leg.metre_of(flight.here_w))
            size = float(np.linalg.norm(offset))
            if math.isfinite(size) and not self._jumped(offset, step_s):
                limit = MOVED_M + MOVED_PER_METRE * max(0.0, leg.metre_of(flight.here_w))
                if not self._leapt:
                    limit += DRIFTED_M * min(1.0, _age_s(flight) / DRIFTED_S)
                self.moved_s = self.moved_s + step_s if size > limit else 0.0
                bounded = offset * min(1.0, MOST_M / max(size, 1e-6))
                self._drift = self._drift + (bounded - self._drift) * (step_s / (TIME_S + step_s))
                self._seen = self._seen + (bounded - self._seen) * (step_s / (AIM_TIME_S + step_s))
                self._learn(offset, leg, flight, step_s)
        self._push_outward(flight, leg)
        along = _along(self._position, leg)
        # What is small may as well be the fit's own error: only a real drift is followed.
        size = float(np.linalg.norm(along))
        along = along * (size**2 / (size**2 + DOUBT_M**2))
        self.aim_w = self._seen - _along(self._seen, leg) + along
        self.shift_w = self._drift - _along(self._drift, leg) + along + self._push * leg.view_w
        return self.shift_w

    def _learn(self, offset: Float, leg: Leg, flight: Flight, step_s: float) -> None:
        """Learn the position's own drift, near the root, where a blade hardly droops.

        Across this blade it is what is seen here; along it, what was seen of blades that lie
        otherwise. So the metre of a photo is right although no blade shows it.
        """
        if leg.metre_of(flight.here_w) > NO_DROOP_SHARE * leg.length_m:
            return
        across = self._position - _along(self._position, leg)
        self._position = self._position + (offset - across) * (step_s / (LEARN_S + step_s))

    def _jumped(self, offset: Float, step_s: float) -> bool:
        """Return whether an offset is not believed yet, because it came from one scan to the next.

        What is seen first of a blade is believed: there is nothing to have jumped from.
        """
        bounded = offset * min(1.0, MOST_M / max(float(np.linalg.norm(offset)), 1e-6))
        apart = float(np.linalg.norm(bounded - self._drift))
        if not self._begun or apart < JUMP_M or self._jumped_s > JUMP_STAYS_S:
            # A position drifts; it does not leap and stay there.
            self._leapt = self._leapt or (self._begun and apart >= JUMP_M)
            self._begun, self._jumped_s = True, 0.0 if apart < JUMP_M else self._jumped_s
            return False
        self._jumped_s += step_s
        return True

    def _push_outward(self, flight: Flight, leg: Leg) -> None:
        """Below the wanted surface clearance of this blade, move out; come back slowly."""
        clearance = flight.observation.clearance
        step = PUSH_MPS * flight.dt_s
        if clearance is None or clearance.nearest_m is None or clearance.nearest_w is None:
            return
        least = flight.settings.guard.outward_below_m
        near = clearance.nearest_m - flight.settings.airframe.radius_m
        towards = np.array(clearance.nearest_w) - flight.here_w
        ahead = float(towards @ -leg.view_w) > 0.8 * float(np.linalg.norm(towards))
        if near < least and ahead:
            self._push = min(self._push + step, MOST_PUSH_M)
        elif near > least + 0.5 or not ahead:
            self._push = max(self._push - step / 2, 0.0)


def _along(vector_w: Float, leg: Leg) -> Float:
    """Return the part (3,) of a vector along the blade."""
    return float(vector_w @ leg.axis_w) * leg.axis_w


def _age_s(flight: Flight) -> float:
    """Return how long ago the rotor was measured."""
    return math.inf if flight.rotor is None else flight.now_s - flight.rotor.stamp_s
