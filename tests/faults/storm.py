"""Many small faults, one after the other and at once, at random moments of whole missions."""

from __future__ import annotations

import dataclasses

import numpy as np

from benchmarks.virtual_flight import TERMINAL
from benchmarks.virtual_turbine import Truth
from mission.flight.command import Phase
from mission.flight.observation import RequestKind
from tests.faults.fault import Fault, Seen
from tests.faults.rehearsal import mission

#: Mission seconds between the beginnings of two faults, and how long one lasts, at most.
APART_S, LASTS_S = 8.0, 3.0
#: A mission that is held up time and again takes longer, but it ends.
LIMIT_S = 2400.0
ASKED = (RequestKind.PAUSE, RequestKind.RESUME, RequestKind.SKIP)


def _part(name, **changes):
    """Return a fault of one part of what is observed: values, or None for the part's absence."""

    def spoil(flight, observation, since_s):
        value = getattr(observation, name)
        if value is None:
            return observation
        new = {k: v(value, since_s) if callable(v) else v for k, v in changes.items()}
        part = dataclasses.replace(value, **new) if new else None
        return dataclasses.replace(observation, **{name: part})

    return spoil


def _older(scan, since_s):
    return scan.stamp_s - since_s


def _photo_failed(flight, observation, since_s):
    camera = observation.camera
    if camera is None or not camera.last_photo_id:
        return observation
    last = camera.last_photo_id
    camera = dataclasses.replace(camera, last_photo_id=last - 1, failed_photo_id=last)
    return dataclasses.replace(observation, camera=camera)


FAULTS = {
    "scans stop": _part("clearance", stamp_s=_older),
    "scans repeated": _part("clearance", repeated=True),
    "scans at 4 Hz": _part("clearance", scan_rate_hz=4.0),
    "scans at 3 Hz": _part("clearance", scan_rate_hz=3.0),
    "no scan": _part("clearance"),
    "sensing dead": lambda _, observation, __: dataclasses.replace(
        observation, sensing_alive=False
    ),
    "position old": _part("vehicle", stamp_s=_older),
    "camera gone": _part("camera", online=False),
    "no camera": _part("camera"),
    "gimbal silent": _part("gimbal"),
    "no metering": _part("exposure"),
    "out of range": _part("exposure", in_range=False),
    "blade not seen": _part("blade"),
    "no prior": _part("hub_prior"),
    "no rotor": _part("rotor"),
    "photo failed": _photo_failed,
}


class Storm:
    """Begins faults at random; a hook of a virtual flight."""

    def __init__(self, seed):
        self._rng = np.random.default_rng(seed)
        self._next_s = 0.0
        self._under_way = []
        self.spoilt, self.begun = 0, []
        self._paused = False

    def __call__(self, flight, observation):
        now_s = flight.now_s
        if now_s > self._next_s and flight.machine.phase is not Phase.PREFLIGHT:
            self._next_s = now_s + self._rng.uniform(0.0, APART_S)
            self._begin(flight, now_s)
        self._under_way = [one for one in self._under_way if now_s < one[2]]
        for name, begun_s, _ in self._under_way:
            told = FAULTS[name](flight, observation, now_s - begun_s)
            self.spoilt += told is not observation
            observation = told
        return observation

    def _begin(self, flight, now_s):
        if self._paused or self._rng.random() < 0.08:
            kind = RequestKind.RESUME if self._paused else ASKED[int(self._rng.integers(3))]
            self._paused = kind is RequestKind.PAUSE
            self.begun.append((round(now_s, 2), str(kind)))
            flight.ask(kind)
            return
        name = list(FAULTS)[int(self._rng.integers(len(FAULTS)))]
        self.begun.append((round(now_s, 2), name))
        self._under_way.append((name, now_s, now_s + self._rng.uniform(0.05, LASTS_S)))


def one_mission(seed):
    """Fly one mission through a storm; return it, what it flew, and the storm."""
    storm = Storm(seed)
    truth = Truth(stop_angle_deg=float(seed * 37 % 120))
    flight = mission(truth, storm, sides=("PS", "LE"))
    flown = flight.run(0.0)
    try:
        while flight.machine.state not in TERMINAL and flight.now_s < LIMIT_S:
            flight.one_tick(flown)
    except Exception as error:
        error.add_note(f"seed {seed}, {flight.now_s:.2f} s, after {storm.begun[-6:]}")
        raise
    return flight, flown, storm


def storms(count, seed):
    """Fly so many missions, each through a storm of its own."""
    ends, spoilt, begun, least = {}, 0, 0, np.inf
    for number in range(seed, seed + count):
        flight, flown, storm = one_mission(number)
        state = str(flight.machine.state)
        words = f"seed {number}: {state}, {flight.machine.report().words}; {storm.begun[-6:]}"
        assert flight.machine.state in TERMINAL, words
        assert not flight.armed or state == "released", words
        assert flown.min_clearance_m >= 8.0, f"{words}; {flown.min_clearance_m:.2f} m"
        ends[state] = ends.get(state, 0) + 1
        spoilt, begun = spoilt + storm.spoilt, begun + len(storm.begun)
        least = min(least, flown.min_clearance_m)
    told = ", ".join(f"{n} {state.replace('_', ' ')}" for state, n in sorted(ends.items()))
    words = f"{begun} small faults in {count} missions, seeds from {seed}: {told}"
    return Seen(spoilt, end="ended", clearance_m=float(least), figure=words)


ROWS: tuple[Fault, ...] = (
    Fault(43, "small faults of every device, at random, in a whole mission",
          lambda: storms(1, seed=1), "", None, "ended"),
    Fault(43, "small faults of every device, at random, in 60 missions",
          lambda: storms(60, seed=100), "", None, "ended", slow=True),
)  # fmt: skip
