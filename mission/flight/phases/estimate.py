"""Estimate: measure the rotor from before the hub until estimates agree, then plan the passes.

p_d = p_h - v_n d_c: after each estimate the vehicle moves before the newest hub (Shi et al. 2025,
Algorithm 1). The angle has converged when successive estimates differ by less than epsilon_a, or
when so many were made that their mean is known as well.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mission.flight.agreed_rotor import agreed_rotor, same_blade, settled
from mission.flight.around import before_hub
from mission.flight.command import MissionState, Phase, SensingMode
from mission.flight.events import Event
from mission.flight.flight import Flight, Intent
from mission.flight.observation import BladeEstimate, RotorEstimate
from mission.flight.phases.leave import leave
from mission.flight.phases.track import Track
from mission.flight.plan import Plan, plan_steps
from mission.flight.resumption import adopt_steps, renamed, turned_words
from mission.flight.rotor_model import MeasuredBlade, rotor_model
from mission.flight.skin import blade_skin
from perception.geometry import rotation_from_quaternion, stop_angle_difference_deg
from perception.rotor import RefusalCode

RECENTRE_M = 0.7
#: Farther than this the accumulated points are of another place: begin anew there.
ANEW_M = 2.5
MOVE_MPS = 1.0
#: A hub this far from the one found in the ascent is not this rotor's.
IMPLAUSIBLE_M = 20.0
#: Where estimates are refused, other distances are tried in turn (shares of d_c), farther first:
#: from there more of each blade lies within the LiDAR's height of view.
OTHER_DISTANCES = (1.0, 1.25, 0.8)
REFUSALS_A_PLACE = 2
#: Estimates that agree but are this unsure are compared with looks from this share of d_c: of a
#: large rotor whose blades hang aside little but the roots lies within view from near.
UNSURE_DEG, FARTHER = 0.35, 1.75
#: What saw too little says nothing against the looks before it; any other refusal does.
SAW_TOO_LITTLE = frozenset(
    {RefusalCode.NO_POINTS, RefusalCode.TWO_BLADES, RefusalCode.LOW_VISIBILITY}
)


class Estimate:
    """Collect estimates, re-centre, decide; then plan while holding."""

    phase = Phase.ESTIMATE

    def __init__(self) -> None:
        self._begun_s: float | None = None
        self._sequence = -1
        self._good: list[RotorEstimate] = []
        self._taken = self._refused = 0
        self._agreed: list[RotorEstimate] = []
        self._unsure: list[RotorEstimate] = []
        """What agreed from near, while it is looked from farther."""
        self._moving = False
        self._work: Iterator[Plan | None] | None = None

    def resume(self, flight: Flight) -> None:
        """Hold, and measure anew from here."""
        self._moving = False
        self._good.clear()
        flight.sense(SensingMode.ROTOR, new=True)

    def step(self, flight: Flight) -> Intent:
        """Take the newest estimate, move, or advance the plan by a slice."""
        if self._begun_s is None:
            self._begun_s = flight.now_s
            newest = flight.observation.rotor
            self._sequence = -1 if newest is None else newest.sequence
            flight.sense(SensingMode.ROTOR, new=True)
        yaw, gimbal = flight.yaw_to(flight.hub_w), flight.aim_at(flight.hub_w)
        if self._work is not None:
            return self._plan(flight, Intent("planning the passes", flight.hold(yaw)))
        if self._moving and flight.arrived(1.0):
            self._moving = False
        setpoint = flight.follow(yaw) if self._moving else flight.hold(yaw)
        words = f"measuring the rotor ({len(self._good)} estimates)"
        intent = Intent(words, setpoint=setpoint, gimbal=gimbal)
        newest = flight.observation.rotor
        if newest is not None and newest.sequence > self._sequence:
            self._sequence = newest.sequence
            self._take(flight, newest)
        if self._converged(flight) and not self._look_from_farther(flight):
            words = "" if flight.earlier is None else turned_words(flight.earlier, self._good[-1])
            if words:
                return leave(flight, intent, MissionState.REFUSED, words)
            self._finish(flight)
            return intent
        estimation = flight.settings.estimation
        late = flight.now_s - self._begun_s > estimation.timeout_s
        if late or self._taken >= estimation.max_iterations:
            if self._unsure:
                self._agreed = self._unsure
                self._finish(flight)
                return intent
            words = "the stop angle did not converge"
            if newest is not None and newest.refusal is not None:
                words += f": {newest.refusal_text or newest.refusal}"
            return leave(flight, intent, MissionState.REFUSED, words)
        return intent

    def _take(self, flight: Flight, estimate: RotorEstimate) -> None:
        flight.iterations += 1
        self._taken += 1
        if estimate.refusal is not None:
            self._refused += 1
            if estimate.refusal not in SAW_TOO_LITTLE:
                self._good.clear()
            flight.note("estimate", f"refused: {estimate.refusal_text or estimate.refusal}")
            if estimate.refusal == RefusalCode.ROTOR_TURNING:
                flight.raised.add(Event.ROTOR_TURNING)
            elif self._refused % REFUSALS_A_PLACE == 0:
                self._move(flight, np.array(flight.hub_w), flight.normal_w)
            return
        hub = np.array(estimate.hub_w)
        prior = flight.observation.hub_prior
        if prior is not None and prior.hub_w is not None and (
            float(np.linalg.norm(hub - np.array(prior.hub_w))) > IMPLAUSIBLE_M
        ):  # fmt: skip
            self._good.clear()
            flight.note("estimate", "dropped: its hub is far from the one found in the ascent")
            return
        flight.rotor = estimate
        self._good.append(estimate)
        flight.note(
            "estimate", f"{estimate.stop_angle_deg:.2f} deg, sigma {estimate.sigma_deg:.2f} deg"
        )
        if self._move(flight, hub, np.array(estimate.normal_w)):
            # It was looked at from a wrong place.
            self._good.clear()

    def _move(
        self, flight: Flight, hub: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
        normal: np.ndarray[tuple[int, ...], np.dtype[np.float64]] | None,
    ) -> bool:  # fmt: skip
        """Move before a hub, where that is not near; say whether it is far from here."""
        if normal is None:
            return False
        share = OTHER_DISTANCES[(self._refused // REFUSALS_A_PLACE) % len(OTHER_DISTANCES)]
        share = FARTHER if self._unsure else share
        goal = before_hub(hub, normal, flight.settings.estimation.stand_off_m * share)
        apart = float(np.linalg.norm(goal - flight.here_w))
        if apart < RECENTRE_M or self._moving:
            return False
        self._moving = True
        flight.go(goal[None], MOVE_MPS)
        if apart > ANEW_M:
            flight.sense(SensingMode.ROTOR, new=True)
        return apart > ANEW_M

    def _converged(self, flight: Flight) -> bool:
        estimation = flight.settings.estimation
        last = self._good[-estimation.agree_count :]
        if len(last) < estimation.agree_count or self._moving:
            return False
        if settled(self._good):
            self._agreed = list(self._good)
            return True
        self._agreed = last
        pairs = itertools.pairwise(last)
        return all(
            abs(stop_angle_difference_deg(a.stop_angle_deg, b.stop_angle_deg))
            < estimation.agree_deg
            for a, b in pairs
        )

    def _look_from_farther(self, flight: Flight) -> bool:
        """Keep what agrees but is unsure, and go where more of the blades is seen; once."""
        sigmas = [one.sigma_deg for one in self._agreed]
        if self._unsure or float(np.median(sigmas)) <= UNSURE_DEG:
            return False
        self._unsure = self._agreed
        flight.note("estimate", "they agree, but little of the blades is seen: from farther")
        newest = self._good[-1]
        self._move(flight, np.array(newest.hub_w), np.array(newest.normal_w))
        self._good.clear()
        return True

    def _finish(self, flight: Flight) -> None:
        """Fix the rotor, build the model, begin to plan."""
        agreed, good = self._agreed, self._good or self._agreed
        # Measured again near 0 deg, the blades keep the names that their photos bear.
        named_deg = flight.named_deg
        if flight.earlier is not None and flight.earlier.stop_angle_deg is not None:
            named_deg = flight.earlier.stop_angle_deg
        agreed = [renamed(one, named_deg) for one in agreed]
        good = [renamed(one, named_deg) for one in good]
        rotor = agreed_rotor(agreed)
        if flight.named_deg is None:
            flight.named_deg = rotor.stop_angle_deg
        pitches = {b.name: _agreed_pitch(good, b, flight) for b in rotor.blades}
        # One look may not have told what the others have: all that go by the rotor know it.
        blades = tuple(replace(b, pitch_deg=pitches[b.name]) for b in rotor.blades)
        flight.rotor = rotor = replace(rotor, blades=blades)
        prior = flight.observation.hub_prior
        flight.model = rotor_model(
            np.array(rotor.hub_w),
            np.array(rotor.normal_w),
            [MeasuredBlade(b.name, b.direction_w, pitches[b.name]) for b in rotor.blades],
            flight.turbine,
            None if prior is None else np.array(prior.tower_w),
            None if prior is None else np.array(prior.tower_axis_w),
        )
        flight.note("estimate", f"converged at {rotor.stop_angle_deg:.2f} deg")
        self._work = plan_steps(
            flight.model, flight.turbine, flight.settings, _wanted(flight),
            flight.here_w, flight.ground_m,
            rotation_from_quaternion(flight.vehicle.quaternion_wb)[:, 2],
            None if flight.home_w is None else np.array(flight.home_w),
        )  # fmt: skip

    def _plan(self, flight: Flight, intent: Intent) -> Intent:
        if self._work is None:
            return intent
        found = next(self._work)
        if found is None:
            return intent
        if flight.plan is not found:
            self._open_books(flight, found)
            if flight.earlier is not None:
                self._work = adopt_steps(flight, found, flight.earlier)
                return intent
        hub, here = flight.hub_w, flight.here_w
        outward = (here - hub) / float(np.linalg.norm(here - hub))
        way_in = np.stack([hub + outward * flight.clear_radius_m, here])
        flight.open_corridor([way_in, *(leg.line() for leg in found.legs)])
        flight.note("plan", f"{len(found.legs)} legs for {len(found.passes)} sides")
        flown = any(book.photographed_m() > 0.0 for book in flight.ledger.sides.values())
        if not found.legs and not flown:
            words = "no side can be flown: " + (
                found.passes[0].unseen[0].reason if found.passes else "none was asked for"
            )
            return leave(flight, intent, MissionState.REFUSED, words)
        return Intent(
            intent.words,
            intent.setpoint,
            gimbal=intent.gimbal,
            then=Track(flight.settings.positioning),
        )

    def _open_books(self, flight: Flight, found: Plan) -> None:
        flight.plan, flight.leg_index = found, 0
        frames = found.model.frames
        skins = {frame.name: blade_skin(frame, flight.turbine) for frame in frames}
        flight.ledger.measured(skins, found.model)
        for side_pass in found.passes:
            flight.ledger.open_side(side_pass)
            for gap in side_pass.unseen:
                flight.note(
                    "unseen",
                    f"{side_pass.blade} {side_pass.side} "
                    f"{gap.from_m:.0f}-{gap.to_m:.0f} m: {gap.reason}",
                )


def _wanted(flight: Flight) -> list[tuple[str, str]]:
    """Return the sides to fly: asked for in the request and the settings, not yet flown."""
    inspection, request = flight.settings.inspection, flight.request
    blades = [b for b in inspection.blades if request is None or b in request.blades]
    sides = [s for s in inspection.sides if request is None or s in request.sides]
    wanted = [(blade, side) for blade in blades for side in sides]
    books = flight.ledger.sides
    return [key for key in wanted if key not in books
            or books[key].photographed_m() < 0.9 * books[key].planned.planned_m]  # fmt: skip


def _agreed_pitch(
    estimates: list[RotorEstimate], blade: BladeEstimate, flight: Flight
) -> float | None:
    """Return the median of a blade's measured pitch; where none was, the site's own figure."""
    found = [same_blade(blade, estimate) for estimate in estimates if estimate.blades]
    pitches = [b.pitch_deg for b in found if b.pitch_deg is not None]
    if pitches:
        return float(np.median(pitches))
    assumed = flight.site.blade_pitch_deg
    if assumed is not None:
        words = f"blade {blade.name}: not measured, taken as {assumed:.0f} deg as told"
        flight.note("pitch", words)
    return assumed
