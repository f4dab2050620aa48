"""Machine and guard in a virtual flight with something going wrong; time is counted, not waited."""

from __future__ import annotations

import copy
import dataclasses
import math
from functools import cache

import numpy as np

from benchmarks.virtual_flight import TERMINAL, VirtualFlight
from benchmarks.virtual_turbine import Truth
from config.inspection import Inspection
from config.presets import load_turbine
from config.settings import Settings
from config.turbine import Site
from mission.flight.command import Phase
from tests.faults.fault import Seen

FLYING = (
    Phase.TAKEOFF,
    Phase.ASCEND,
    Phase.APPROACH,
    Phase.ESTIMATE,
    Phase.TRACK,
    Phase.STAND_OFF,
    Phase.RETURN,
)
SETTLE_S = 6.0


def mission(truth=None, hook=None, sides=("PS",)):
    """Return a virtual flight along one side of one blade of a small turbine."""
    turbine = load_turbine("v27")
    settings = Settings(inspection=Inspection(sides=sides, blades=("A",)))
    apart = turbine.rotor_radius_m + 30.0
    site = Site(name="t1", turbine="v27", tower_north_m=apart + 3.0, tower_east_m=-2.0)
    truth = dataclasses.replace(truth or Truth(), tower_w=(0.0, apart, 0.0))
    flight = VirtualFlight(settings, site, turbine, truth, hook)
    flight.start(sides=sides, blades=("A",))
    return flight


@cache
def _kept():
    """One mission, kept as it was a second (or less, where it is shorter) into each phase."""
    flight = mission()
    kept, flown, entered = {}, flight.run(limit_s=0.05), {}
    while flight.machine.state not in TERMINAL:
        phase = flight.machine.phase
        entered.setdefault(phase, flight.now_s)
        flight.one_tick(flown)
        some = 0.2 if phase in (Phase.PREFLIGHT, Phase.STAND_OFF) else 1.0
        if phase not in kept and flight.now_s - entered[phase] >= some:
            kept[phase] = copy.deepcopy(flight)
    return kept


def flight_in(phase):
    """Return a flight of its own that has just come into a phase."""
    return copy.deepcopy(_kept()[phase])


def distance_m(flight):
    """Return the distance of the airframe's outermost point to the true turbine."""
    apart = float(flight._model.distance(flight.position[None])[0])
    return apart - flight.settings.airframe.radius_m


def rehearse(change, event, *, phase=Phase.TRACK, after_s=SETTLE_S, for_s=math.inf, limit_s=600.0):
    """Fly, disturb from a moment on, and watch.

    ``change(flight, observation, t_s)`` returns what the machine is told ``t_s`` after the
    beginning; a tick counts as disturbed where that is not what was observed.
    """
    flight = flight_in(phase)
    flown = flight.run(limit_s=after_s)
    flown.events.clear()
    flown.photos.clear()
    begin_s, disturbed = flight.now_s, 0

    def hook(flight, observation):
        nonlocal disturbed
        t_s = flight.now_s - begin_s
        if t_s > for_s:
            return observation
        told = change(flight, observation, t_s)
        disturbed += told is not observation
        return told

    flight.hook = hook
    reacted_s, watched = None, []
    wanted = set(event.split())
    while flight.machine.state not in TERMINAL and flight.now_s - begin_s < limit_s:
        command = flight.one_tick(flown).command
        if reacted_s is None and wanted & {e.name for e in flown.events}:
            if stops(command):
                reacted_s = flight.now_s - begin_s
        elif reacted_s is not None and len(watched) < 80:
            watched.append((distance_m(flight), float(np.linalg.norm(flight.velocity))))
    speed = watched[0][1] if watched else 0.0
    closed = watched[0][0] - min(d for d, _ in watched) if watched else 0.0
    return (
        Seen(
            disturbed=disturbed,
            events=frozenset(e.name for e in flown.events),
            reacted_s=reacted_s,
            end=str(flight.machine.state),
            closed_m=closed,
            allowed_m=0.5 * speed + speed**2 / 3 + 0.1,
            clearance_m=flown.min_clearance_m,
        ),
        flight,
        flown,
    )


def stops(command):
    """Return whether a command moves nothing: silence, or a place to stay at."""
    return command.setpoint is None or command.setpoint.velocity_w == (0.0, 0.0, 0.0)


def told(part, **changes):
    """Return a change of one part of what is observed."""

    def change(flight, observation, t_s):
        value = getattr(observation, part)
        if value is None:
            return observation
        new = {k: v(flight, t_s) if callable(v) else v for k, v in changes.items()}
        return dataclasses.replace(observation, **{part: dataclasses.replace(value, **new)})

    return change


def seen(*arguments, figure=None, **options):
    """Rehearse, and keep only what was seen; ``figure(flight, flown)`` adds words."""
    result, flight, flown = rehearse(*arguments, **options)
    if figure is None:
        return result
    return dataclasses.replace(result, figure=figure(flight, flown))
