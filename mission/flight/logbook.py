"""The machine's book of itself: phases and their times, events, what an operator is shown."""

from __future__ import annotations

from collections.abc import Iterable

from mission.flight.command import MissionState, Phase, Progress
from mission.flight.events import EventRecord, Reaction
from mission.flight.flight import Flight, Intent, PhaseStep
from mission.flight.phases.hold import Released
from mission.flight.phases.landed import Landed
from mission.flight.report import MissionReport, PhaseTime


class Logbook:
    """Grows with the mission; decides nothing."""

    def __init__(self) -> None:
        self._times: list[PhaseTime] = []
        self._entered_s = 0.0
        self._started_s: float | None = None
        self._ended_s: float | None = None
        self._events: list[EventRecord] = []
        self._coverage = (0, 0.0)
        self._words = "waiting for a mission"

    def started(self, now_s: float) -> None:
        """The mission begins."""
        self._started_s = now_s

    def taken_up_again(self) -> None:
        """What had ended goes on."""
        self._ended_s = None

    def entered(self, before: Phase, now_s: float) -> None:
        """A phase gave way to the next."""
        self._times.append(PhaseTime(before, self._entered_s, now_s))
        self._entered_s = now_s

    def ticked(self, flight: Flight, phase: PhaseStep, words: str) -> None:
        """A tick was decided: what it says, and whether the mission is over with it."""
        over = flight.state not in {MissionState.RUNNING, MissionState.PAUSED}
        if over and isinstance(phase, Landed | Released) and self._ended_s is None:
            self._ended_s = flight.now_s
        self._words = words

    def happened(self, events: Iterable[EventRecord]) -> None:
        """Keep events."""
        self._events.extend(events)

    def progress(self, flight: Flight, phase: Phase, intent: Intent) -> Progress:
        """Return what an operator is shown at a tick."""
        clearance = flight.observation.clearance
        near = None
        if clearance is not None and clearance.nearest_m is not None:
            near = clearance.nearest_m - flight.settings.airframe.radius_m
        taken = flight.ledger.taken()
        if taken != self._coverage[0]:
            self._coverage = (taken, flight.ledger.coverage())
        rotor = flight.rotor
        return Progress(
            phase=phase,
            state=flight.state,
            words=intent.words,
            pass_index=_pass_flown(flight),
            pass_count=0 if flight.plan is None else len(flight.plan.legs),
            # What is flown, and not what is next: stretches are flown again in between.
            blade=flight.task.blade,
            side=flight.task.side,
            metre=intent.metre,
            distance_m=intent.distance_m,
            clearance_m=near,
            stop_angle_deg=None if rotor is None else rotor.stop_angle_deg,
            sigma_deg=None if rotor is None else rotor.sigma_deg,
            photos=taken,
            coverage=self._coverage[1],
            flight=1 if flight.request is None else flight.request.flight,
            swap=flight.swap,
        )

    def report(self, flight: Flight, phase: Phase, *, brief: bool) -> MissionReport:
        """Return the mission so far; ``brief``: without the share of skin and what went well."""
        now = flight.now_s if self._ended_s is None else self._ended_s
        running = PhaseTime(phase, self._entered_s, now)
        return MissionReport(
            state=flight.state,
            words=flight.outcome_words or self._words,
            started_s=self._started_s,
            duration_s=0.0 if self._started_s is None else now - self._started_s,
            phases=(*self._times, running),
            rotor=flight.rotor,
            iterations=flight.iterations,
            passes=flight.ledger.reports(skins=not brief),
            events=tuple(
                event for event in self._events if not brief or event.severity >= Reaction.WARN
            ),
            swap=flight.swap,
        )


def _pass_flown(flight: Flight) -> int:
    """Return the number of the pass that is flown; a stretch flown again counts as its own."""
    legs = () if flight.plan is None else flight.plan.legs
    if flight.leg_index >= len(legs):
        return len(legs)
    leg, task = legs[flight.leg_index], flight.task
    return flight.leg_index + ((leg.blade, leg.side) == (task.blade, task.side))
