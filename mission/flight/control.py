"""Who has the vehicle: we, the autopilot after a silence of ours, or whoever took it over."""

from __future__ import annotations

from mission.flight.flight import Flight, PhaseStep
from mission.flight.observation import FlightMode, Vehicle
from mission.flight.phases.hold import Hold, Idle, Released
from mission.flight.phases.home import Home
from mission.flight.phases.landed import Landed
from mission.flight.phases.preflight import Preflight
from mission.flight.phases.takeoff import Engage, Takeoff

#: Modes are reported once a second: an older one may still be told for so long.
MODE_CHANGE_S = 3.0


def taken_over(flight: Flight, phase: PhaseStep) -> bool:
    """Return whether somebody has left OFFBOARD without our asking: the vehicle is theirs."""
    vehicle = flight.observation.vehicle
    if vehicle is None or isinstance(phase, (Idle, Preflight, Released)):
        return False
    if isinstance(phase, Landed) and not phase.flown:
        # Never ours, or handed back already.
        return False
    if vehicle.mode is FlightMode.UNKNOWN:
        return False
    allowed = {FlightMode.OFFBOARD}
    if not flight.engaged and isinstance(phase, Takeoff | Engage | Hold):
        allowed |= {FlightMode.TAKEOFF, FlightMode.HOLD}
        if isinstance(phase, Engage) and phase.from_mode is not None:
            # What an operator took up again begins in the mode that it was left in.
            allowed.add(phase.from_mode)
        if not vehicle.in_air:
            # Before the climb the mode is still whatever it was on the ground.
            return False
        if regains(phase) and _asked_by_others(vehicle):
            allowed = {FlightMode.OFFBOARD}
    if isinstance(phase, Home | Landed):
        allowed |= {FlightMode.LAND}
        if flight.now_s - flight.land_asked_s < MODE_CHANGE_S:
            allowed |= {FlightMode.TAKEOFF, FlightMode.HOLD}
        if vehicle.landed:
            return False
    if vehicle.mode in allowed or (flight.engaged and vehicle.mode_stamp_s < flight.engaged_s):
        return False
    return not (flight.engaged and failsafe_of_our_silence(flight))


def failsafe_of_our_silence(flight: Flight) -> bool:
    """Return whether the autopilot holds because it heard nothing of us, and nobody else.

    It does when our own clock knows of a gap long enough and where, as far as the vehicle
    tells, nobody has asked for another mode since.
    """
    silent, vehicle = flight.observation.silent, flight.vehicle
    if silent is None or vehicle.mode is not FlightMode.HOLD:
        return False
    if silent.closed:
        # So short that the autopilot may not have minded: it has to say itself that it did.
        return vehicle.intended is FlightMode.OFFBOARD
    return not _asked_by_others(vehicle)


def _asked_by_others(vehicle: Vehicle) -> bool:
    """Return whether the vehicle tells that somebody has asked for another mode than ours."""
    return vehicle.intended not in {None, FlightMode.UNKNOWN, FlightMode.OFFBOARD}


def what_goes_on(phase: PhaseStep) -> PhaseStep:
    """Return what goes on after a hold, and after control was taken up again."""
    if isinstance(phase, Hold):
        phase = phase.then
    if isinstance(phase, Engage) and phase.after_silence:
        return phase.then
    return phase


def regains(phase: PhaseStep) -> bool:
    """Return whether control is being taken up again after a gap of our own."""
    inner = phase.then if isinstance(phase, Hold) else phase
    return isinstance(inner, Engage) and inner.after_silence


def takes_over(phase: PhaseStep) -> bool:
    """Return whether a hovering vehicle is being taken over, which may hover anywhere."""
    inner = phase.then if isinstance(phase, Hold) else phase
    return isinstance(inner, Engage) and inner.taken_over
