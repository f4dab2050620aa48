"""Commands computed anew: machine and guard given each recorded tick's observation.

Machine and guard are pure, and a tick's record holds what they knew; the guard's surroundings are
recorded beside, found by their stamp. So every command comes out as it was, to the last bit, or
the code, the settings or the record is not what flew.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from pydantic import ValidationError

from config.settings import Settings
from drivers.bus import Key
from drivers.codecs import BadMessage, decode_points
from mission.flight.command import Command, Setpoint
from mission.flight.guard import NOTHING_AROUND, Guard, GuardedCommand, Surroundings
from mission.flight.machine import Machine
from mission.remote.messages import TickRecord
from mission.replay.difference import Difference, first_difference
from mission.replay.recorded import Mission, Recorded, RecordedMission

#: Messages looked through for occupancy that was overtaken by the tick that used it.
LOOK_AHEAD = 200
#: Occupancy that is remembered: what was looked ahead for must outlive the ticks before it.
KEPT_SURROUNDINGS = 2 * LOOK_AHEAD
#: As the flight process does when it was silent: the mode must have been reported anew.
STALL_S = 0.4
_KEYS = frozenset({Key.COMMAND, Key.OCCUPANCY})


@dataclass(slots=True)
class CommandReplay:
    """How the recomputed commands compare to the recorded ones."""

    ticks: int = 0
    equal: int = 0
    first: Difference | None = None
    fields: Counter[str] = field(default_factory=Counter)
    """How often each field was the first to differ within its tick."""
    refused: int = 0
    """Setpoints that the guard replaced, as recorded."""
    refused_anew: int = 0
    events_anew: Counter[str] = field(default_factory=Counter)
    without_surroundings: int = 0
    """Ticks whose occupancy is not in the recording."""
    flown_s: float = 0.0
    """Mission time from the first tick to the last."""
    took_s: float = 0.0
    """Process time of the replay."""
    state: str = ""
    """How the recomputed mission stood at the last tick."""

    @property
    def speed(self) -> float:
        """Mission seconds per second of computing."""
        return self.flown_s / self.took_s if self.took_s > 0 else 0.0


def replay_commands(recorded: RecordedMission, settings: Settings | None = None) -> CommandReplay:
    """Recompute every command of a recording and compare.

    ``settings``: others than it was flown with; the observations stay as they were, whatever the
    other commands would have done to them. Raises `NotARecording`.
    """
    begun_s = time.process_time()
    mission = recorded.mission
    replay = _Replay(mission, mission.settings if settings is None else settings)
    for message, record in _ticks(recorded, replay):
        replay.tick(record, message.mission_s)
    result = replay.result
    result.took_s = time.process_time() - begun_s
    return result


class _Replay:
    """Machine and guard of one replayed mission."""

    def __init__(self, mission: Mission, settings: Settings) -> None:
        chosen = settings.inspection.model_copy(
            update={"blades": mission.intent.blades, "sides": mission.intent.sides}
        )
        settings = settings.model_copy(update={"inspection": chosen})
        site = next(site for site in settings.sites if site.name == mission.intent.site)
        self._machine = Machine(settings, site, mission.turbine)
        self._guard = Guard(settings)
        self._gate = _Gate()
        self._surroundings: deque[Surroundings] = deque(maxlen=KEPT_SURROUNDINGS)
        self._missing: set[float] = set()
        """Stamps that were looked for and not found: from before the recording, or dropped."""
        self._last_tick: int | None = None
        self._begun_s: float | None = None
        self.result = CommandReplay()

    def see(self, message: Recorded) -> None:
        """Take in an occupancy as it went to the guard."""
        try:
            points, stamp_s = decode_points(message.payload)
        except BadMessage:
            return
        self._surroundings.append(Surroundings(points.astype(np.float64), stamp_s))

    def knows(self, stamp_s: float | None) -> bool:
        """Return whether the occupancy that a tick looked at is at hand."""
        if stamp_s is None or stamp_s == float("-inf") or stamp_s in self._missing:
            return True
        return any(one.stamp_s == stamp_s for one in self._surroundings)

    def give_up(self, stamp_s: float) -> None:
        """Look for an occupancy no more."""
        self._missing.add(stamp_s)

    def tick(self, record: TickRecord, mission_s: float) -> None:
        """Recompute one tick and compare."""
        observation, result = record.observation, self.result
        if self._last_tick is not None and observation.tick != self._last_tick + 1:
            self._note("tick", observation.tick, self._last_tick + 1, observation.tick, mission_s)
        self._last_tick = observation.tick
        self._begun_s = mission_s if self._begun_s is None else self._begun_s
        result.flown_s = mission_s - self._begun_s
        command, events = self._machine.step(observation)
        surroundings = self._around(record.surroundings_s)
        guarded = self._guard.check(
            command, observation, surroundings, self._machine.airspace(), self._gate.previous
        )
        result.ticks += 1
        result.refused += _is_refusal(record)
        result.refused_anew += guarded.refused
        result.events_anew.update(event.name for event in events)
        result.state = guarded.command.progress.state
        self._compare(record, guarded, mission_s)
        self._gate.after(guarded.command, record)

    def _around(self, stamp_s: float | None) -> Surroundings:
        if stamp_s is None:  # recorded before it was told: the newest
            return self._surroundings[-1] if self._surroundings else NOTHING_AROUND
        if stamp_s == float("-inf"):
            return NOTHING_AROUND
        for one in reversed(self._surroundings):
            if one.stamp_s == stamp_s:
                return one
        self.result.without_surroundings += 1
        before = [one for one in self._surroundings if one.stamp_s < stamp_s]
        return max(before, key=lambda one: one.stamp_s, default=NOTHING_AROUND)

    def _compare(self, record: TickRecord, guarded: GuardedCommand, mission_s: float) -> None:
        if record.command == guarded.command and record.refused == guarded.reason:
            self.result.equal += 1
            return
        found = first_difference(record.command, guarded.command)
        if found is None and record.refused != guarded.reason:
            found = ("refused", record.refused, guarded.reason)
        if found is None:
            self.result.equal += 1
            return
        self._note(*found, record.observation.tick, mission_s)

    def _note(
        self, path: str, recorded: object, recomputed: object, tick: int, mission_s: float
    ) -> None:
        result = self.result
        result.fields[path] += 1
        if result.first is None:
            result.first = Difference(tick, mission_s, path, recorded, recomputed)


class _Gate:
    """The setpoint that last left for the autopilot: the guard bounds the growth of speed by it.

    Newer recordings say of each tick whether its setpoint left; of older ones it is found as the
    flight process decides it.
    """

    def __init__(self) -> None:
        self.previous: Setpoint | None = None
        self._sent_s = float("-inf")
        self._mode_after_s = float("-inf")

    def after(self, command: Command, record: TickRecord) -> None:
        """Remember what left in this tick."""
        if command.setpoint is None:
            self.previous, self._sent_s = None, float("-inf")
            return
        sent = self._may_send(record) if record.sent is None else record.sent
        if sent:
            self.previous, self._sent_s = command.setpoint, record.observation.now_s

    def _may_send(self, record: TickRecord) -> bool:
        now_s, vehicle = record.observation.now_s, record.observation.vehicle
        if now_s - self._sent_s > STALL_S and self._sent_s > float("-inf"):
            self._mode_after_s, self._sent_s = now_s, float("-inf")
        return vehicle is not None and vehicle.mode_stamp_s >= self._mode_after_s


def _ticks(recorded: RecordedMission, replay: _Replay) -> Iterator[tuple[Recorded, TickRecord]]:
    """Yield the ticks, each when the occupancy it looked at has been seen."""
    messages = recorded.messages(_KEYS)
    waiting: deque[Recorded] = deque()
    for message in messages:
        waiting.append(message)
        while waiting:
            first = waiting.popleft()
            if first.key == Key.OCCUPANCY:
                replay.see(first)
                continue
            record = _parsed(first)
            if record is None:
                continue
            _look_ahead(record, replay, messages, waiting)
            yield first, record


def _look_ahead(
    record: TickRecord,
    replay: _Replay,
    messages: Iterator[Recorded],
    waiting: deque[Recorded],
) -> None:
    """See the occupancy of a tick that stands before it in the recording."""
    stamp_s = record.surroundings_s
    if stamp_s is None or replay.knows(stamp_s):
        return
    for _ in range(LOOK_AHEAD):
        message = next(messages, None)
        if message is None:
            break
        if message.key == Key.OCCUPANCY:
            replay.see(message)
            if replay.knows(stamp_s):
                return
        else:
            waiting.append(message)
    replay.give_up(stamp_s)


def _parsed(message: Recorded) -> TickRecord | None:
    try:
        return TickRecord.model_validate_json(message.payload)
    except ValidationError:
        return None


def _is_refusal(record: TickRecord) -> bool:
    return (
        bool(record.refused)
        and not record.refused.endswith("trimmed")
        and (record.refused != "slowed towards an obstacle")
    )
