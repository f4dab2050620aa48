"""The machine: observation in, command and events out, once a tick. Pure and deterministic.

It takes requests and active events, lets the worst reaction win, and else lets the phase decide.
It knows no clock but ``observation.now_s`` and does no I/O: the same observations give the same
commands, which is what a replay checks.
"""

from __future__ import annotations

import math
from dataclasses import replace

from config.settings import Settings
from config.turbine import Site, Turbine
from mission.flight.command import Action, Command, MissionState, Phase
from mission.flight.control import (
    failsafe_of_our_silence,
    regains,
    taken_over,
    takes_over,
    what_goes_on,
)
from mission.flight.events import POLICY, Event, EventRecord, Reaction, arbitrate, worst
from mission.flight.exposure_order import ExposureOrder
from mission.flight.flight import Flight, Intent, PhaseStep
from mission.flight.guard import Airspace
from mission.flight.interruption import (
    hold_now,
    hold_then,
    home_without_control,
    in_air,
    land,
    note_ending,
    release,
)
from mission.flight.ledger import Ledger, PhotoStatus
from mission.flight.leg import Leg
from mission.flight.logbook import Logbook
from mission.flight.observation import (
    Observation,
    Request,
    RequestKind,
    Vec3,
)
from mission.flight.phases.hold import Hold, Idle, Released
from mission.flight.phases.home import Home
from mission.flight.phases.landed import Landed
from mission.flight.phases.leave import StandOff
from mission.flight.phases.preflight import Preflight
from mission.flight.phases.remeasure import Remeasure
from mission.flight.phases.takeoff import Engage, Takeoff
from mission.flight.phases.track import Track
from mission.flight.plan import Plan
from mission.flight.report import MissionReport
from mission.flight.still_offset import StillOffset
from mission.flight.watch import Watch

LEAVING = (StandOff, Home, Landed, Released)
#: Holds that also stop a return: without a trusted position nothing is flown.
HOLDS_EVERYWHERE = frozenset({Event.LINK_SILENT, Event.POSITION_STALE, Event.POSITION_JUMP})
TOLD_AGAIN_S = 10.0
#: How the mission ends for an event that sends it home; else ENDED_SAFELY.
OUTCOME = {
    Event.ROTOR_TURNING: MissionState.REFUSED,
    Event.OFFBOARD_REFUSED: MissionState.REFUSED,
    Event.LINK_LOST: MissionState.FAILED,
}


class Machine:
    """One mission on one turbine."""

    def __init__(self, settings: Settings, site: Site, turbine: Turbine) -> None:
        self._flight = Flight(settings, site, turbine)
        self._phase: PhaseStep = Idle()
        self._watch = Watch()
        self._seen_s: dict[Event, float] = {}
        self._exposure = ExposureOrder()
        self._stills = StillOffset()
        self._logbook = Logbook()

    # --- what others read -----------------------------------------------------------------

    @property
    def phase(self) -> Phase:
        """The phase of the next tick."""
        return self._phase.phase

    @property
    def state(self) -> MissionState:
        """How the mission stands."""
        return self._flight.state

    @property
    def engaged(self) -> bool:
        """Whether the vehicle is flown by our setpoints."""
        return self._flight.engaged

    @property
    def plan(self) -> Plan | None:
        """What is flown, once the rotor was measured."""
        return self._flight.plan

    @property
    def leg(self) -> Leg | None:
        """Which of the plan's lines is flown along, or flown to."""
        return self._phase.leg if isinstance(self._phase, Track) else None

    @property
    def ledger(self) -> Ledger:
        """The book of photos and passes."""
        return self._flight.ledger

    def airspace(self) -> Airspace:
        """Return what the guard has to know about the turbine and the plan."""
        return self._flight.airspace()

    def tower_foot_w(self) -> Vec3:
        """Return where the tower stands on the ground: as found, else as told."""
        x, y, z = self._flight.tower_w
        return float(x), float(y), float(z)

    def report(self, *, brief: bool = False) -> MissionReport:
        """Return the mission so far.

        ``brief``: without the share of skin shown, and of the events only what was amiss: what is
        cheap enough to be told in flight.
        """
        return self._logbook.report(self._flight, self._phase.phase, brief=brief)

    # --- a tick ---------------------------------------------------------------------------

    def step(self, observation: Observation) -> tuple[Command, tuple[EventRecord, ...]]:
        """Decide one tick."""
        flight = self._flight
        gap = observation.now_s - flight.now_s
        flight.dt_s = min(max(gap, 1e-3), 0.2) if flight.observation.tick >= 0 else 0.05
        flight.observation = observation
        flight.look()
        self._earlier(observation)
        self._photos(observation)
        if self._stills.step(observation):
            flight.note("camera", self._stills.words)
        if taken_over(flight, self._phase):
            flight.raised.add(Event.PILOT_TOOK_OVER)
        intent = self._decided(observation)
        if intent.then is not None:
            self._enter(intent.then)
        self._logbook.ticked(flight, self._phase, intent.words)
        command = self._command(observation, intent)
        records = tuple(flight.records)
        flight.records.clear()
        self._logbook.happened(records)
        return command, records

    def _decided(self, observation: Observation) -> Intent:
        """Let requests, then a gap of our own, then the worst event, then the phase decide."""
        forced = self._requests(observation)
        waits = self._silenced()
        if forced is None and waits is not None and waits.then is not None:
            return waits
        intent = forced or self._events_of_tick() or waits or self._stepped()
        # Until the mode was read, nothing that is decided may be sent.
        return intent if waits is None else replace(intent, setpoint=None)

    def _stepped(self) -> Intent:
        if self._flight.observation.vehicle is None and not isinstance(
            self._phase, (Idle, Preflight, Released, Landed)
        ):
            return Intent("no telemetry from the vehicle")
        return self._phase.step(self._flight)

    def _enter(self, phase: PhaseStep) -> None:
        flight, before = self._flight, self._phase
        self._phase = phase
        if phase.phase is before.phase:
            return
        self._logbook.entered(before.phase, flight.now_s)
        flight.note("phase", phase.phase)

    def _command(self, observation: Observation, intent: Intent) -> Command:
        flight = self._flight
        ev = self._exposure.due(intent.ev, observation)
        silent = isinstance(self._phase, Released | Idle)
        return Command(
            tick=observation.tick,
            setpoint=None if silent else intent.setpoint,
            action=intent.action,
            gimbal=None if silent else intent.gimbal,
            ev=None if silent else ev,
            photo=None if silent else intent.photo,
            sensing=self._stills.told(flight.task),
            progress=self._logbook.progress(flight, self._phase.phase, intent),
            takeoff_height_m=intent.takeoff_height_m,
        )

    # --- what arrives ---------------------------------------------------------------------

    def _earlier(self, observation: Observation) -> None:
        flight, earlier = self._flight, observation.earlier
        if earlier is not None and flight.earlier is None:
            flight.earlier = earlier
            flight.ledger.number_from(earlier.next_photo_id)

    def _photos(self, observation: Observation) -> None:
        ledger, camera = self._flight.ledger, observation.camera
        if camera is not None:
            ledger.settle(camera.last_photo_id, PhotoStatus.TAKEN)
            ledger.settle(camera.failed_photo_id, PhotoStatus.FAILED)
        for result in observation.photos:
            if result.kept:
                ledger.settle(result.photo_id, PhotoStatus.TAKEN)
                ledger.judged(result.photo_id, exposed=result.exposed)
            elif ledger.settle(result.photo_id, PhotoStatus.REJECTED) is not None:
                self._flight.note("photo", f"{result.photo_id} rejected: {result.reason}")

    def _silenced(self) -> Intent | None:
        """After a gap of our own: read the mode, and only then go on or ask for offboard again."""
        flight, phase = self._flight, self._phase
        silent, vehicle = flight.observation.silent, flight.observation.vehicle
        if silent is None or vehicle is None or not flight.engaged:
            return None
        if not silent.closed and vehicle.mode_stamp_s < silent.read_after_s:
            return Intent("our own control stood still: reading the mode first")
        if not failsafe_of_our_silence(flight):
            return None
        policy = POLICY[Event.OWN_SILENCE]
        flight.note(Event.OWN_SILENCE, policy.words, policy.reaction)
        flight.engaged = False
        flight.follower.stop()
        again = Engage(what_goes_on(phase), after_silence=True)
        paused = isinstance(phase, Hold) and phase.paused
        return Intent(policy.words, then=Hold(again, policy.words, paused=paused))

    # --- requests -------------------------------------------------------------------------

    def _requests(self, observation: Observation) -> Intent | None:
        """Carry out what operators ask; the last that forces an intent wins."""
        forced: Intent | None = None
        for request in observation.requests:
            self._flight.note("request", f"{request.kind} by {request.operator or 'unknown'}")
            forced = self._request(request) or forced
        return forced

    def _request(self, request: Request) -> Intent | None:
        flight, phase = self._flight, self._phase
        if request.kind is RequestKind.START:
            return self._start(request) if isinstance(phase, Idle) else None
        if isinstance(phase, Idle):
            return None
        if request.kind is RequestKind.RESUME:
            return self._resume()
        if isinstance(phase, Landed | Released):
            return None
        if isinstance(phase, Preflight) or (isinstance(phase, Takeoff) and not in_air(flight)):
            return self._before_flight(request)
        if request.kind is RequestKind.STOP:
            return release(flight, phase, "stopped: handed to the pilot", ask_hold=True)
        if request.kind is RequestKind.ABORT:
            if isinstance(phase, StandOff | Home):
                return None
            note_ending(flight, MissionState.ENDED_SAFELY, "aborted by the operator")
            if not flight.engaged:
                return home_without_control(flight, phase, "aborted: landing")
            return hold_then(flight, StandOff(Home()), "aborted: holding, then leaving")
        if request.kind is RequestKind.PAUSE:
            flight.state = MissionState.PAUSED
            if isinstance(phase, Hold):
                phase.pause()
                return None
            return hold_then(flight, phase, "paused by the operator", paused=True)
        inner = phase.then if isinstance(phase, Hold) else phase
        if isinstance(inner, Track):
            inner.skip(flight)
        return None

    def _before_flight(self, request: Request) -> Intent | None:
        if request.kind not in {RequestKind.STOP, RequestKind.ABORT}:
            return None
        note_ending(self._flight, MissionState.ENDED_SAFELY, "called off before the take-off")
        vehicle = self._flight.observation.vehicle
        armed = vehicle is not None and vehicle.armed
        return Intent(
            "called off", action=Action.DISARM if armed else None, then=Landed(flown=False)
        )

    def _start(self, request: Request) -> Intent | None:
        flight = self._flight
        if request.site and request.site != flight.site.name:
            flight.note("request", f"refused: this mission is for {flight.site.name}")
            return None
        flight.request, flight.state = request, MissionState.RUNNING
        self._logbook.started(flight.now_s)
        return Intent("mission started", then=Preflight())

    def _resume(self) -> Intent | None:
        flight, phase = self._flight, self._phase
        if isinstance(phase, Hold):
            phase.release(flight)
            return None
        if isinstance(phase, Released) and phase.then is not None and in_air(flight):
            # A new request is the one way back to offboard control.
            flight.engaged, flight.state = False, MissionState.RUNNING
            flight.outcome, flight.outcome_words = None, ""
            self._logbook.taken_up_again()
            vehicle = flight.observation.vehicle
            mode = None if vehicle is None else vehicle.mode
            return Intent("taken up again", then=Engage(phase.then, from_mode=mode))
        return None

    # --- events ---------------------------------------------------------------------------

    def _events_of_tick(self) -> Intent | None:
        flight, phase = self._flight, self._phase
        if isinstance(phase, Idle | Preflight):
            flight.raised.clear()
            return None
        active = self._watch.update(flight, phase.phase)
        for one in sorted(active):
            # A condition that comes and goes is told once, until it has been away for a while.
            if flight.now_s - self._seen_s.get(one, -math.inf) > TOLD_AGAIN_S:
                flight.note(one, POLICY[one].words, POLICY[one].reaction)
            self._seen_s[one] = flight.now_s
        if isinstance(phase, Released | Landed):
            if Event.PILOT_TOOK_OVER in active and isinstance(phase, Landed):
                return release(flight, phase, POLICY[Event.PILOT_TOOK_OVER].words)
            return None
        reaction, event = arbitrate(active), worst(active)
        if event is None or reaction <= Reaction.WARN:
            return None
        return self._react(reaction, event, active)

    def _react(self, reaction: Reaction, event: Event, active: set[Event]) -> Intent | None:
        flight, phase, words = self._flight, self._phase, POLICY[event].words
        if reaction is Reaction.RELEASE:
            failed = event is Event.LINK_LOST
            return release(flight, phase, words, ask_hold=event is Event.FRAME_RESET, failed=failed)
        if reaction is Reaction.LAND and (regains(phase) or takes_over(phase)):
            # Beside the rotor the autopilot's hold is better than its landing.
            return release(flight, phase, words)
        if reaction is Reaction.LAND:
            note_ending(flight, OUTCOME.get(event, MissionState.ENDED_SAFELY), words)
            return land(flight, words)
        if isinstance(phase, Takeoff | Engage):
            return None
        inner = what_goes_on(phase)
        leaving = isinstance(inner, LEAVING)
        if reaction is Reaction.RETURN and not self._going_home(inner):
            flight.rotor_open = flight.rotor_open and event is not Event.ROTOR_TURNING
            note_ending(flight, OUTCOME.get(event, MissionState.ENDED_SAFELY), words)
            flight.swap = flight.swap or event is Event.BATTERY_RESERVE
            if not flight.engaged:
                return home_without_control(flight, phase, words)
            return hold_now(flight, words, StandOff(Home()))
        if reaction is Reaction.STAND_OFF and not leaving:
            return hold_now(flight, words, self._measure_again())
        holding = {e for e in active if POLICY[e].reaction is Reaction.HOLD}
        if leaving:
            holding &= HOLDS_EVERYWHERE
        if not holding:
            return None
        # After a silence of the link nothing is resumed but by an operator.
        paused = Event.LINK_SILENT in holding and not leaving
        if paused:
            flight.state = MissionState.PAUSED
        if isinstance(phase, Hold):
            phase.disturbed()
            if paused and not phase.paused:
                phase.pause(words)
            return None
        return hold_then(flight, phase, words, paused=paused)

    def _going_home(self, phase: PhaseStep) -> bool:
        return isinstance(phase, Home | Landed | Released) or (
            isinstance(phase, StandOff) and isinstance(phase.then, Home)
        )

    def _measure_again(self) -> PhaseStep:
        """Leave the rotor and measure it anew; what was photographed stays photographed."""
        return StandOff(Remeasure())
