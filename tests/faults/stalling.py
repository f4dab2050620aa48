"""Our own control stands still while the virtual vehicle goes on, as PX4 would."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from benchmarks.virtual_flight import TICK_S, VirtualFlight
from mission.flight.command import Phase
from mission.flight.observation import FlightMode
from mission.processes.dead_man import DeadMan
from tests.faults.fault import Seen
from tests.faults.rehearsal import distance_m, flight_in

LOSS_S = 0.5
#: For so long after a stall we still see what we knew before it.
BACKLOG_S = 0.12


class StallingFlight(VirtualFlight):
    """A flight behind a dead-man, above an autopilot with COM_OF_LOSS_T and a failsafe."""

    def ready(self):
        """Begin; ``times`` will hold when setpoints arrived."""
        self.dead_man, self.times = DeadMan(), []
        self.received = self.known = None
        self.woke_s = -math.inf
        self.failsafe, self.intended = False, FlightMode.OFFBOARD
        self.hook = StallingFlight._look
        return self

    @staticmethod
    def _look(flight, observation):
        engaged = flight.machine.engaged
        silent = flight.dead_man.look(flight.now_s, engaged=engaged)
        vehicle = dataclasses.replace(observation.vehicle, intended=flight.intended)
        if flight.now_s - flight.woke_s < BACKLOG_S:
            vehicle = flight.known
        flight.known = vehicle
        return dataclasses.replace(observation, silent=silent, vehicle=vehicle)

    def _obey(self, command):
        if command.setpoint is not None:
            may = self.dead_man.may_send(self.now_s, self.now_s, self._mode_reported[1])
            if may:
                self.dead_man.sent(self.now_s)
                self.times.append(self.now_s)
                self.received = command
                if self.failsafe and self.intended is FlightMode.OFFBOARD:
                    self.mode, self.failsafe = FlightMode.OFFBOARD, False
            else:
                command = dataclasses.replace(command, setpoint=None)
        if command.action is not None:
            self.intended = FlightMode(command.action.value)
        self._lose()
        super()._obey(command)

    def _lose(self):
        lost = bool(self.times) and self.now_s - self.times[-1] > LOSS_S
        if lost and self.mode is FlightMode.OFFBOARD:
            self.mode, self.failsafe = FlightMode.HOLD, True

    def stall(self, seconds):
        """Our process stands still; the autopilot flies the last setpoint, then holds."""
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            self._lose()
            if self.mode is FlightMode.OFFBOARD:
                VirtualFlight._obey(self, dataclasses.replace(self.received, action=None))
            else:
                self.velocity = self.velocity * (1 - TICK_S / 0.4)
                self.position = self.position + TICK_S * self.velocity
        self.woke_s = self.now_s


def blocked(seconds=5.0, *, pilot_holds=False):
    """Block control while a blade is flown; return what the autopilot then saw."""
    flight = flight_in(Phase.TRACK)
    flight.__class__ = StallingFlight
    flown = flight.ready().run(limit_s=8.0)
    before = flight.position.copy()
    begun_s, apart = flight.now_s, distance_m(flight)
    flight.stall(seconds)
    held = flight.mode is FlightMode.HOLD
    if pilot_holds:
        flight.intended, flight.failsafe = FlightMode.HOLD, False
    last_s, back_s, sent = flight.times[-1], flight.now_s, len(flight.times)
    flown.events.clear()
    first_s = read_s = None
    for _ in range(round(8.0 / TICK_S)):
        flight.one_tick(flown)
        if read_s is None and flight._mode_reported[1] >= back_s:
            read_s = flight.now_s
        if first_s is None and len(flight.times) > sent:
            first_s = flight.now_s
    closest = apart - flown.min_clearance_m
    moved = float(np.linalg.norm(flight.position - before)) if pilot_holds else None
    flight.run(limit_s=600.0)
    return (
        dataclasses.replace(
            Seen(
                disturbed=round(seconds / TICK_S),
                events=frozenset(e.name for e in flown.events),
                reacted_s=max(0.0, last_s - begun_s),
                end=str(flight.machine.state),
                clearance_m=flown.min_clearance_m,
            ),
            figure=_words(held, read_s, first_s, back_s, closest, moved),
        ),
        read_s,
        first_s,
    )


def _words(held, read_s, first_s, back_s, closest, moved):
    assert held, "the autopilot did not hold"
    words = f"the mode was read {read_s - back_s:.2f} s after control was back"
    if first_s is None:
        return f"{words}; nothing was sent any more; stood within {moved:.1f} m"
    assert first_s >= read_s, "something was sent before the mode was read"
    return f"{words}, the next setpoint {first_s - back_s:.2f} s after; closed {closest:.2f} m"


def blocked_for_5_s():
    return blocked()[0]


def pilot_holds_meanwhile():
    seen, _, first_s = blocked(pilot_holds=True)
    assert first_s is None
    return seen
