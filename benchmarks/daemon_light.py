"""From a decoded picture to the exposure command on the wire, heard from outside the daemon.

Pictures are heard on the bus, which tells when each was decoded; so is what metering made of them.
Commands are heard as bytes on the vehicle's own link. A command belongs to the first picture of
those in a row that ask for its exposure.
"""

from __future__ import annotations

import select
import socket
import struct
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import dropwhile, groupby, takewhile
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter
from pymavlink.dialects.v20 import common as mavlink

from drivers.autopilot_tap import frames
from drivers.bus import Bus, Key, Sample
from drivers.clock import Clock
from drivers.codecs import frame_times
from mission.flight.observation import ExposureState

GOAL_MS = 60.0
_EXPOSURE = TypeAdapter(ExposureState)
_SAME_EV = 0.01
#: A picture that was decoded so long before a command did not cause it: the film's light comes
#: again after two seconds.
_MOST_S = 1.5
_EV, _MAVLINK_2, _PARAM_EXT_SET = b"CAM_EV", 0xFD, 323
_HEARTBEAT_S = 0.5
_LOG_COMPONENT, _LOG_TYPE = 155, 41


@dataclass(frozen=True, slots=True)
class TimedEv:
    """An EV, asked for by a picture that was taken then or ordered then on the wire."""

    at_s: float
    ev: float


@dataclass(slots=True)
class LightHeard:
    """All that was heard; mission times."""

    decoded_s: dict[float, float] = field(default_factory=dict)
    """By the time at which a picture was taken."""
    asked: list[TimedEv] = field(default_factory=list)
    ordered: list[TimedEv] = field(default_factory=list)

    def lags_ms(self) -> list[float]:
        """Return for each command how long before it the picture was decoded that asked for it."""
        changed = [one for _, (one, *_) in groupby(self.ordered, key=lambda one: one.ev)]
        wishes = [
            TimedEv(self.decoded_s[wish.at_s], wish.ev)
            for wish in self.asked
            if wish.at_s in self.decoded_s
        ]
        causes = [(one, _cause(wishes, one)) for one in changed]
        return [1e3 * (one.at_s - cause_s) for one, cause_s in causes if cause_s is not None]


@dataclass(frozen=True, slots=True)
class LightLag:
    """Milliseconds from a decoded picture to the command on the wire."""

    p50: float
    p99: float
    most: float
    commands: int

    @classmethod
    def of(cls, lags_ms: Sequence[float]) -> LightLag | None:
        """Return the figures of some lags; None of none."""
        if not lags_ms:
            return None
        p50, p99 = np.percentile(lags_ms, (50, 99))
        return cls(float(p50), float(p99), float(max(lags_ms)), len(lags_ms))


def _cause(wishes: Sequence[TimedEv], one: TimedEv) -> float | None:
    """Return when the first of the newest pictures in a row was decoded that ask for an order's EV.

    ``wishes``: of each picture, at the time when it was decoded.
    """
    before = (wish for wish in wishes if 0 < one.at_s - wish.at_s < _MOST_S)
    newest_first = sorted(before, key=lambda wish: wish.at_s, reverse=True)
    # What was asked for while the camera was still busy with this one has its own command.
    row = dropwhile(lambda wish: abs(wish.ev - one.ev) > _SAME_EV, newest_first)
    in_row = takewhile(lambda wish: abs(wish.ev - one.ev) <= _SAME_EV, row)
    return min((wish.at_s for wish in in_row), default=None)


@contextmanager
def light_heard(bus: Bus, tap_file: Path, system_id: int, clock: Clock) -> Iterator[LightHeard]:
    """Hear pictures, metering and commands until left."""
    heard, stop = LightHeard(), threading.Event()

    def take_frame(sample: Sample) -> None:
        taken_s, decoded_s = frame_times(sample.payload, sample.attachment)
        heard.decoded_s[taken_s] = decoded_s

    def take_exposure(sample: Sample) -> None:
        state = _EXPOSURE.validate_json(sample.payload)
        heard.asked.append(TimedEv(state.stamp_s, state.ev_wanted))

    def listen() -> None:
        heard.ordered.extend(_orders(tap_file, system_id, clock, stop))

    ends = [bus.follow(Key.FRAME, take_frame), bus.follow(Key.EXPOSURE, take_exposure)]
    thread = threading.Thread(target=listen, name="light-heard", daemon=True)
    thread.start()
    try:
        yield heard
    finally:
        stop.set()
        thread.join()
        for end in ends:
            end()


def _orders(
    tap_file: Path, system_id: int, clock: Clock, stop: threading.Event
) -> Iterator[TimedEv]:
    """Yield every command that leaves."""
    writer = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=_LOG_COMPONENT)
    beat = mavlink.MAVLink_heartbeat_message(
        _LOG_TYPE, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    ).pack(writer)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        wire.bind(("127.0.0.1", 0))
        beaten_s = float("-inf")
        while not stop.is_set():
            now_s = clock.now_s()
            if not 0 <= now_s - beaten_s < _HEARTBEAT_S * clock.factor():
                beaten_s = now_s
                wire.sendto(beat, ("127.0.0.1", int(tap_file.read_text())))
            if not select.select([wire], [], [], 0.1)[0]:
                continue
            data = wire.recv(65536)
            at_s = clock.now_s()
            for frame in frames(data):
                ev = ordered_ev(frame)
                if ev is not None:
                    yield TimedEv(at_s, ev)


def ordered_ev(frame: bytes) -> float | None:
    """Return the EV that a MAVLink 2 frame asks of the camera, None of any other frame."""
    if frame[0] != _MAVLINK_2 or int.from_bytes(frame[7:10], "little") != _PARAM_EXT_SET:
        return None
    # Target system and component, 16 bytes of name, the value's bytes; zeros at the end are cut.
    payload = frame[10 : 10 + frame[1]].ljust(22, b"\0")
    if payload[2:18].rstrip(b"\0") != _EV:
        return None
    return float(struct.unpack_from("<f", payload, 18)[0])
