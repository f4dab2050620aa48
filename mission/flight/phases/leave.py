"""Leaving: out of the rotor along the known-free way, with what is to come after it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mission.flight.command import MissionState, Phase
from mission.flight.flight import Flight, Intent, PhaseStep
from mission.flight.phases.home import Home
from perception.values import Float

OUT_SPEED_MPS = 2.0
BLIND_SPEED_MPS = 1.0
RETRY_S = 3.0


def leave(flight: Flight, intent: Intent, outcome: MissionState, words: str) -> Intent:
    """End the mission early: write down how and why, and go home from the next tick."""
    if flight.outcome is None:
        flight.outcome, flight.outcome_words = outcome, words
        flight.note("ending", words)
    return replace(intent, words=words, then=StandOff(Home()))


class StandOff:
    """Fly out of the closed sphere by the roadmap, or back the way the rotor was approached."""

    phase = Phase.STAND_OFF

    def __init__(self, then: PhaseStep) -> None:
        self._then = then
        self._started_s: float | None = None

    @property
    def then(self) -> PhaseStep:
        """What follows outside."""
        return self._then

    def resume(self, _flight: Flight) -> None:
        """Find the way out again from here."""
        self._started_s = None

    def step(self, flight: Flight) -> Intent:
        """Fly out; the next phase begins outside the sphere."""
        # The roadmap is the plan's: it lies where the position has drifted to since.
        shift, words = flight.drift_w, "leaving the rotor"
        here = flight.here_w - shift
        outside = float(np.linalg.norm(here - flight.hub_w)) >= flight.sphere_radius_m
        if outside:
            return Intent("clear of the rotor", setpoint=flight.hold(), then=self._then)
        blocked = bool(flight.observation.guard_refused)
        if self._started_s is None or (blocked and flight.now_s - self._started_s > RETRY_S):
            self._started_s = flight.now_s
            scan = flight.observation.clearance
            fresh = scan is not None and flight.now_s - scan.stamp_s < 0.5
            # All flown: the way that is soonest home. Something is wrong: the shortest.
            homeward = isinstance(self._then, Home) and flight.outcome is None
            speed_mps = OUT_SPEED_MPS if fresh else BLIND_SPEED_MPS
            flight.go(way_out(flight, homeward), speed_mps, shift)
        yaw = flight.yaw_to(flight.hub_w + shift)
        return Intent(words, setpoint=flight.follow(yaw, 1.0, shift, firm=False))


def way_out(flight: Flight, homeward: bool) -> Float:
    """Return points (K, 3) from near the vehicle to outside the sphere, if need be homeward.

    In the plan's frame: to be moved by the position's drift when they are flown.
    """
    here, hub = flight.here_w - flight.drift_w, flight.hub_w
    if flight.plan is not None:
        home = np.array(flight.home_w) if homeward and flight.home_w is not None else None
        way = flight.plan.roadmap.way_out(here, home)
        if way is not None:
            # The last node lies beyond the tips: a step farther is outside for certain.
            outward = way[-1] - hub
            outward /= np.linalg.norm(outward)
            end = hub + outward * (flight.sphere_radius_m + 2.5)
            return np.concatenate([way[1:], end[None]])
    normal = flight.normal_w
    if normal is None:
        outward = np.array([here[0] - hub[0], here[1] - hub[1], 0.0])
        outward /= max(float(np.linalg.norm(outward)), 1e-6)
    else:
        outward = -normal if float((here - hub) @ normal) <= 0 else normal
    # Straight on from here, parallel to the line of the approach, until outside.
    along = float((here - hub) @ outward)
    across = float(np.linalg.norm(here - hub)) ** 2 - along**2
    reach = np.sqrt(max(0.0, (flight.sphere_radius_m + 2.5) ** 2 - across))
    ahead: Float = here + outward * max(reach - along, 1.0)
    return ahead[None]
