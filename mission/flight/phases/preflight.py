"""Preflight: every item on the list passes, and what the machine itself can see is in order."""

from __future__ import annotations

from mission.flight.command import Action, MissionState, Phase
from mission.flight.exposure_order import exposure_words
from mission.flight.flight import Flight, Intent
from mission.flight.observation import FlightMode
from mission.flight.phases.landed import Landed
from mission.flight.phases.takeoff import Takeoff
from mission.flight.phases.takeover import take_over

WAIT_S = 120.0
#: The list must be clean for as long before the motors start.
SETTLED_S = 0.5
HOLD_AGAIN_S = 5.0
#: Modes in which an autopilot on the ground may refuse to arm; a pilot's mode is the pilot's.
NOT_ARMABLE = {FlightMode.OFFBOARD, FlightMode.LAND, FlightMode.RETURN, FlightMode.TAKEOFF}


class Preflight:
    """Wait a bounded time for everything to be ready, then arm; else refuse, naming each item."""

    phase = Phase.PREFLIGHT

    def __init__(self) -> None:
        self._since: float | None = None
        self._clean_since: float | None = None
        self._hold_asked_s: float | None = None

    def resume(self, _flight: Flight) -> None:
        """Nothing moved."""

    def step(self, flight: Flight) -> Intent:
        """Check; go on to the take-off, or refuse."""
        now = flight.now_s
        if self._since is None:
            self._since = now
        faults = _faults(flight)
        if faults:
            self._clean_since = None
            if now - self._since > WAIT_S:
                words = "; ".join(faults)
                flight.outcome, flight.outcome_words = MissionState.REFUSED, words
                return Intent(f"refused: {words}", then=Landed(flown=False))
            return Intent(f"waiting: {faults[0]}", action=self._armable_mode(flight))
        if self._clean_since is None:
            self._clean_since = now
        if now - self._clean_since < SETTLED_S:
            return Intent("preflight checks passed")
        flight.note("camera", exposure_words(flight.observation.camera))
        vehicle = flight.vehicle
        if vehicle.in_air:
            return take_over(flight)
        flight.home_w = vehicle.home_w or vehicle.position_w
        return Intent("arming", action=Action.ARM, then=Takeoff(Action.ARM))

    def _armable_mode(self, flight: Flight) -> Action | None:
        """Return a request for hold where it may be only the mode that forbids arming.

        PX4 is left in offboard by its own landing, or in land or return by a failsafe; it cannot be
        armed in any of them.
        """
        vehicle, now = flight.observation.vehicle, flight.now_s
        if vehicle is None or vehicle.armed or vehicle.in_air or vehicle.healthy:
            return None
        late = self._hold_asked_s is None or now - self._hold_asked_s > HOLD_AGAIN_S
        if vehicle.mode not in NOT_ARMABLE or not late:
            return None
        self._hold_asked_s = now
        return Action.HOLD


def _faults(flight: Flight) -> list[str]:
    """Name everything that forbids the take-off, with the command that mends it."""
    observation, request = flight.observation, flight.request
    faults = [f"{i.name}: {i.text}" + (f" ({i.mend})" if i.mend else "")
              for i in observation.preflight if not i.passed]  # fmt: skip
    vehicle = observation.vehicle
    if vehicle is None:
        faults.append("vehicle: no telemetry")
    else:
        airborne = request is not None and request.airborne
        if vehicle.in_air and not airborne:
            faults.append("vehicle: it is in the air (--airborne takes it over where it hovers)")
        if airborne and not vehicle.in_air:
            faults.append("vehicle: it is on the ground, and not to be taken over in the air")
        if not vehicle.healthy and not vehicle.armed:
            faults.append("vehicle: the autopilot says that it may not be armed")
        if vehicle.battery is None:
            if flight.settings.autopilot.strict:
                faults.append("battery: no telemetry")
        elif vehicle.battery < flight.settings.battery.reserve + 0.2:
            faults.append(f"battery: {vehicle.battery:.0%} is too little to begin")
    if request is not None and request.flight > 1 and flight.earlier is None:
        faults.append("earlier flights: what they left behind is being read")
    if request is None or not request.rotor_locked:
        faults.append("operator: the word 'rotor braked and locked, yaw off' is missing")
    clearance = observation.clearance
    if clearance is None or observation.now_s - clearance.stamp_s > 1.0:
        faults.append("LiDAR: no fresh scan")
    if observation.camera is None or not observation.camera.online:
        faults.append("camera: offline")
    if observation.gimbal is None:
        faults.append("gimbal: silent")
    return faults
