"""How a phase is interrupted: by a hold, a landing, or the vehicle handed to whoever flies it.

Each writes into the mission's memory what that means and returns what this tick does.
"""

from __future__ import annotations

from dataclasses import replace

from mission.flight.command import Action, MissionState
from mission.flight.control import regains, takes_over, what_goes_on
from mission.flight.flight import Flight, Intent, PhaseStep
from mission.flight.phases.ascend import Ascend
from mission.flight.phases.hold import Hold, Released
from mission.flight.phases.home import Home
from mission.flight.phases.landed import Landed
from mission.flight.phases.leave import StandOff
from mission.flight.phases.takeoff import Engage


def in_air(flight: Flight) -> bool:
    """Return whether the vehicle says that it flies."""
    vehicle = flight.observation.vehicle
    return vehicle is not None and vehicle.in_air


def note_ending(flight: Flight, outcome: MissionState, words: str) -> None:
    """Write down how the mission will have ended; the first word stands."""
    if flight.outcome is None:
        flight.outcome, flight.outcome_words = outcome, words
        flight.note("ending", words)


def hold_now(flight: Flight, words: str, then: PhaseStep) -> Intent:
    """Stop at this tick; ``then`` begins at the next."""
    flight.follower.stop()
    setpoint = flight.hold() if flight.engaged else None
    return Intent(words, setpoint=setpoint, then=then)


def hold_then(flight: Flight, then: PhaseStep, words: str, *, paused: bool = False) -> Intent:
    """Hold until the cause is gone, or with ``paused`` until an operator says so; then go on."""
    hold = Hold(then, words, paused=paused)
    if not flight.engaged:
        # The autopilot flies the take-off: it holds, and offboard is asked for afterwards.
        again = isinstance(then, Engage) and (then.after_silence or then.taken_over)
        engage = then if again else Engage(Ascend())
        hold = Hold(engage, words, paused=paused)
        return Intent(words, action=Action.HOLD, then=hold)
    intent = hold.step(flight)
    return replace(intent, then=hold)


def home_without_control(flight: Flight, phase: PhaseStep, words: str) -> Intent:
    """End where the autopilot flies: near the rotor only after control was taken up again."""
    if takes_over(phase):
        return release(flight, phase, words)
    if not regains(phase):
        return land(flight, words)
    return Intent(words, then=Hold(Engage(StandOff(Home()), after_silence=True), words))


def land(flight: Flight, words: str) -> Intent:
    """Land where the vehicle is, by the autopilot; on the ground, disarm."""
    flown = in_air(flight)
    flight.engaged = False
    flight.land_asked_s = flight.now_s
    action = Action.LAND if flown else Action.DISARM
    return Intent(words, action=action, then=Landed(flown=flown))


def release(
    flight: Flight, phase: PhaseStep, words: str, *, ask_hold: bool = False, failed: bool = False
) -> Intent:
    """Hand the vehicle over; a request may take ``phase`` up again, unless it ``failed``."""
    inner = what_goes_on(phase)
    again = None if isinstance(inner, Landed) else inner
    flight.engaged = False
    flight.state = MissionState.RELEASED
    if failed:
        flight.outcome, flight.outcome_words = MissionState.FAILED, words
        flight.state, again = MissionState.FAILED, None
    flight.outcome_words = flight.outcome_words or words
    flight.follower.stop()
    action = Action.HOLD if ask_hold else None
    return Intent(words, action=action, then=Released(again, words))
