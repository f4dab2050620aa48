"""Landed: wait for the ground and the disarming, then say how the mission ended."""

from __future__ import annotations

from mission.flight.command import Action, MissionState, Phase, SensingMode
from mission.flight.flight import Flight, Intent
from mission.flight.observation import FlightMode

DISARM_S = 12.0
ASK_AGAIN_S = 3.0
#: A mission that photographed less of what was planned is not completed.
COMPLETE_COVERAGE = 0.8


class Landed:
    """The last phase. ``flown`` is False where the vehicle never left the ground."""

    phase = Phase.LANDED

    def __init__(self, *, flown: bool = True) -> None:
        self._flown = flown
        self._down_s: float | None = None
        self._asked_s: float | None = None
        self._done = False

    @property
    def flown(self) -> bool:
        """Whether the vehicle was flown by us until it landed."""
        return self._flown

    def resume(self, _flight: Flight) -> None:
        """Nothing to find again."""

    def step(self, flight: Flight) -> Intent:
        """Wait; disarm where the autopilot does not; leave it in hold; end."""
        flight.sense(SensingMode.IDLE)
        vehicle, now = flight.observation.vehicle, flight.now_s
        if self._done or not self._flown or vehicle is None:
            self._end(flight)
            return Intent(flight.outcome_words or "inspection completed")
        if vehicle.armed:
            if not vehicle.landed:
                return Intent("landing")
            if self._down_s is None:
                self._down_s = now
            late = now - self._down_s > DISARM_S
            if late and (self._asked_s is None or now - self._asked_s > ASK_AGAIN_S):
                self._asked_s = now
                return Intent("disarming", action=Action.DISARM)
            return Intent("on the ground")
        flight.engaged = False
        self._end(flight)
        # After landing PX4 falls back to OFFBOARD and could not be armed again.
        leave_mode = vehicle.mode in {FlightMode.OFFBOARD, FlightMode.LAND}
        return Intent("landed", action=Action.HOLD if leave_mode else None)

    def _end(self, flight: Flight) -> None:
        self._done = True
        if flight.state not in {MissionState.RUNNING, MissionState.PAUSED}:
            return
        coverage = flight.ledger.coverage(skipped=False)
        if flight.outcome is None and coverage < COMPLETE_COVERAGE:
            flight.outcome = MissionState.ENDED_SAFELY
            flight.outcome_words = f"only {coverage:.0%} of the planned metres were photographed"
        flight.state = flight.outcome or MissionState.COMPLETED
        flight.note("end", f"{flight.state}: {flight.outcome_words or 'all legs flown'}")
