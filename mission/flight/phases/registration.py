"""Registration: the plan is moved to where the LiDAR sees the blade.

The vehicle's position drifts, blades droop and bend: the measured axis lies beside the modelled
one. The plan follows that offset (`LiveOffset`), and, where the surface comes nearer than it
should, moves outward. What blades and tower show of the position's drift is learnt (`FrameDrift`),
for the direction along the blade and for everything that is not the blade. An offset that no drift
explains means that the rotor has moved.
"""

from __future__ import annotations

import math

import numpy as np

from mission.flight.flight import Flight
from mission.flight.leg import Leg
from mission.flight.phases.live_offset import LiveOffset
from perception.frame_drift import SIGHTED_S, FrameDrift, turned
from perception.values import Float

FRESH_S = 0.5
#: No blade is farther beside its model. A position without corrections drifts by metres after the
#: rotor was measured: by that of one moment less that of another, so many sigmas of each.
MOST_M, MOST_SIGMAS = 6.0, 6.0
#: The position's drift is learnt this often; what is seen is wrong by so much, in depth and aside,
#: for longer than that.
LEARN_S = 1.0
DEPTH_SIGMA_M, ASIDE_SIGMA_M = 0.17, 0.5
#: What a blade bends beyond the plan is not drift, and stays: the farther out, the less is learnt.
BEND_PER_METRE = 0.025
#: How far the measured hub may be off, per axis.
ROTOR_SIGMA_M = 0.4
#: Beyond drift and droop: the droop grows with the metre, the drift since the rotor was measured.
MOVED_M = 3.0
MOVED_PER_METRE = 0.03
DRIFTED_M, DRIFTED_S = 3.0, 120.0
#: The turbine's sight tells the drift for so long; a position that wanders by one sigma, then and
#: now, is believed to have drifted by so many.
TOLD_S, MOST_WANDER = 10.0, 4.2
#: A blade does not jump: an offset that does is something else's, or found again after a loss.
JUMP_M = 1.5
#: Unless it stays: then it is what the sensor sees now.
JUMP_STAYS_S = 3.0
LOST_S = 5.0
#: Lost for longer, the blade is taken for where the turbine's drift puts it, within this time.
LEAN_S = 2.0
PUSH_MPS = 0.4
#: Too near by so much it is made good in this time, and by so much more is kept.
PUSH_TIME_S, PUSH_SPARE_M = 1.5, 0.1
MOST_PUSH_M = 4.0
#: A blade that was to be seen and is not is flown past on the fitted rotor, from this far at least.
UNSEEN_M = 14.0


class Registration:
    """The shift (3,) of the plan for the blade that is flown."""

    def __init__(self) -> None:
        self.shift_w: Float = np.zeros(3)
        self.moved_s = 0.0
        """How long the offset has been one that only a moved rotor explains."""
        self.aim_w: Float = np.zeros(3)
        """The same for the camera, which is not pushed outward."""
        self.found_s = math.inf
        """When the LiDAR first saw the blade on this leg."""
        self.drift_w: Float = np.zeros(3)
        """(3,) the position's drift since the rotor was measured, as far as blades have shown."""
        self._live = LiveOffset()
        self._filter: FrameDrift | None = None
        self._rotor_s = math.nan
        self._learnt_s = self._sighted_s = -math.inf
        self._push = 0.0
        self._stamp_s = self._begun_s = -math.inf
        self._blade = ""
        self._begun = False
        self._jumped_s = 0.0
        self._leapt = False

    def begin(self, blade: str) -> None:
        """Begin a leg. What was learnt on another blade is a first guess: the position's drift."""
        if blade != self._blade:
            # Without the other blade's droop.
            self._live.begin(self.drift_w)
            self._begun = False
        self._jumped_s, self._leapt = 0.0, False
        self._blade, self._push, self.moved_s = blade, 0.0, 0.0
        self._begun_s, self.found_s = -math.inf, math.inf
        self.shift_w = self.drift_w

    def fresh(self, flight: Flight, leg: Leg) -> bool:
        """Return whether the newest track is of this blade, recent, and measured."""
        track = flight.observation.blade
        return (
            track is not None
            and track.blade == leg.blade
            and not track.from_model
            and flight.now_s - track.stamp_s < FRESH_S
        )

    def drifted(self, flight: Flight) -> Float:
        """Return the position's drift (3,) by now; it fades where no blade has been seen."""
        rotor = flight.rotor
        if rotor is None:
            self._filter, self.drift_w = None, np.zeros(3)
        elif self._filter is None or rotor.stamp_s != self._rotor_s:
            known = flight.settings.positioning
            self._rotor_s = rotor.stamp_s
            self._filter = FrameDrift(
                known.wander_sigma_m, known.wander_s, rotor.stamp_s, ROTOR_SIGMA_M,
                math.radians(flight.settings.gimbal.yaw_sigma_deg),
            )  # fmt: skip
        if self._filter is not None:
            velocity_w = np.array(flight.vehicle.velocity_w)
            self._filter.move(flight.vehicle.stamp_s, flight.here_w, velocity_w)
            self._sight(self._filter, flight)
            self.drift_w = self._filter.at(flight.now_s)[0]
        return self.drift_w

    def _sight(self, known: FrameDrift, flight: Flight) -> None:
        """Take the newest sighting of the whole turbine."""
        track = flight.observation.blade
        seen = None if track is None else track.turbine
        if seen is None or seen.stamp_s <= max(self._sighted_s, self._rotor_s):
            return
        self._sighted_s = seen.stamp_s
        known.sighted(seen.stamp_s, seen.offset_w, seen.heading_rad, seen.covariance)

    def _drift_at_blade(self, flight: Flight, leg: Leg) -> Float:
        """Return the drift (3,) of what lies before the vehicle: a heading's error turns it."""
        if self._filter is None:
            return self.drift_w
        heading_rad, _ = self._filter.heading(flight.now_s)
        lever = -leg.distance_at(leg.metre_of(flight.here_w - self.shift_w)) * leg.view_w
        return self.drift_w + turned(heading_rad, lever)

    def update(self, flight: Flight, leg: Leg) -> Float:
        """Take the newest track and clearance; return the shift."""
        track, live = flight.observation.blade, self._live
        if not math.isfinite(self._begun_s):
            self._begun_s = flight.now_s
        self.drifted(flight)
        live.advance(flight.now_s, flight.here_w, np.array(flight.vehicle.velocity_w))
        if track is not None and self.fresh(flight, leg) and track.stamp_s > self._stamp_s:
            if track.stamp_s - self._stamp_s > LOST_S:
                # Not seen for a while: what drifted meanwhile has not leapt.
                self._begun = False
            self.found_s = min(self.found_s, flight.now_s)
            step_s = min(track.stamp_s - self._stamp_s, 0.3)
            self._stamp_s = track.stamp_s
            # The foot lies beside the vehicle, wherever a leaning view looks.
            metre = leg.beside(flight.here_w - self.shift_w)
            # What of the offset is the blade's own form is in the plan.
            offset = np.array(track.offset_w) - leg.centre(metre)
            size = float(np.linalg.norm(offset))
            most_m = max(MOST_M, MOST_SIGMAS * flight.settings.positioning.wander_sigma_m)
            bounded = offset * min(1.0, most_m / max(size, 1e-6))
            if math.isfinite(size) and not self._jumped(bounded, step_s):
                moved = self._moved(offset, metre, leg, flight)
                self.moved_s = self.moved_s + step_s if moved else 0.0
                live.correct(track.stamp_s, bounded, step_s)
                self._learn(offset, metre, leg, flight)
        drift_w, lost_s = self._drift_at_blade(flight, leg), self.lost_s(flight)
        if leg.blind or lost_s > LOST_S:
            live.lean(drift_w, 1.0 if leg.blind else flight.dt_s / LEAN_S)
        self._push_outward(flight, leg, lost_s)
        # Across the blade as it is seen; along it, which no blade shows, as other blades told.
        beside_w = live.value_w - _along(live.value_w, leg) + _along(drift_w, leg)
        self.shift_w = beside_w + self._push * leg.view_w
        self.aim_w = beside_w + self._turned_ahead(flight, leg)
        return self.shift_w

    def _turned_ahead(self, flight: Flight, leg: Leg) -> Float:
        """Return how much farther aside (3,) the blade lies where a leaning view looks.

        It is seen beside the vehicle; a heading's error turns it about there.
        """
        if self._filter is None or leg.blind:
            return np.zeros(3)
        heading_rad, _ = self._filter.heading(flight.now_s)
        beside = leg.beside(flight.here_w - self.shift_w)
        return turned(heading_rad, (leg.looked_at(beside) - beside) * leg.axis_w)

    def _learn(self, offset: Float, metre: float, leg: Leg, flight: Flight) -> None:
        """Learn the position's own drift from a blade's offset (3,).

        Where a blade's tip is seen is not taken: thin as it is, it ends a metre early in the scans.
        """
        track = flight.observation.blade
        if self._filter is None or track is None or flight.now_s - self._learnt_s < LEARN_S:
            return
        if flight.now_s - self._sighted_s < SIGHTED_S:
            return
        self._learnt_s = flight.now_s
        noise = flight.settings.positioning.noise_sigma_m
        square = leg.view_w - _along(leg.view_w, leg)
        view: Float = square / float(np.linalg.norm(square))
        bend = BEND_PER_METRE * max(0.0, metre)
        aside: Float = np.asarray(np.cross(leg.axis_w, view), np.float64)
        for across, sigma in ((view, DEPTH_SIGMA_M), (aside, ASIDE_SIGMA_M)):
            total = math.hypot(sigma, bend, noise)
            self._filter.measure(track.stamp_s, across, float(offset @ across), total)

    def _moved(self, offset: Float, metre: float, leg: Leg, flight: Flight) -> bool:
        """Return whether a blade's offset (3,) is more than drift and droop explain.

        Sighted lately, the turbine as a whole tells the drift; no farther than a position wanders.
        """
        limit = MOVED_M + MOVED_PER_METRE * max(0.0, metre)
        if flight.now_s - self._sighted_s < TOLD_S:
            most_m = MOST_WANDER * flight.settings.positioning.wander_sigma_m
            told_w = self._drift_at_blade(flight, leg)
            told_w = told_w - _along(told_w, leg)
            told_w = told_w * min(1.0, most_m / max(float(np.linalg.norm(told_w)), 1e-6))
            if float(np.linalg.norm(offset - told_w)) <= limit:
                return False
        if not self._leapt:
            limit += DRIFTED_M * min(1.0, _age_s(flight) / DRIFTED_S)
        return float(np.linalg.norm(offset)) > limit

    def _jumped(self, offset: Float, step_s: float) -> bool:
        """Return whether an offset is not believed yet, because it came from one scan to the next.

        What is seen first of a blade is believed: there is nothing to have jumped from.
        """
        apart = float(np.linalg.norm(offset - self._live.at(self._stamp_s)))
        if not self._begun or apart < JUMP_M or self._jumped_s > JUMP_STAYS_S:
            # A position drifts; it does not leap and stay there.
            self._leapt = self._leapt or (self._begun and apart >= JUMP_M)
            self._begun, self._jumped_s = True, 0.0 if apart < JUMP_M else self._jumped_s
            return False
        self._jumped_s += step_s
        return True

    def lost_s(self, flight: Flight) -> float:
        """Return for how long the blade that is flown has not been seen, since the leg began."""
        return flight.now_s - max(self._stamp_s, self._begun_s)

    def _push_outward(self, flight: Flight, leg: Leg, lost_s: float) -> None:
        """Below the wanted surface clearance of this blade, move out; come back slowly."""
        clearance = flight.observation.clearance
        step = PUSH_MPS * flight.dt_s
        if clearance is None or clearance.nearest_m is None or clearance.nearest_w is None:
            return
        least = flight.settings.guard.outward_below_m
        near = clearance.nearest_m - flight.settings.airframe.radius_m
        towards = np.array(clearance.nearest_w) - flight.here_w
        ahead = float(towards @ -leg.view_w) > 0.8 * float(np.linalg.norm(towards))
        missing = least + PUSH_SPARE_M - near if ahead else -math.inf
        if lost_s > flight.settings.tracking.lost_foot_s and not leg.blind:
            wanted = leg.distance_at(leg.metre_of(flight.here_w - self.shift_w))
            missing = max(missing, UNSEEN_M - wanted - self._push)
        change = missing * flight.dt_s / PUSH_TIME_S
        self._push = min(max(self._push + min(max(change, -step / 2), step), 0.0), MOST_PUSH_M)


def _along(vector_w: Float, leg: Leg) -> Float:
    """Return the part (3,) of a vector along the blade."""
    return float(vector_w @ leg.axis_w) * leg.axis_w


def _age_s(flight: Flight) -> float:
    """Return how long ago the rotor was measured."""
    return math.inf if flight.rotor is None else flight.now_s - flight.rotor.stamp_s
