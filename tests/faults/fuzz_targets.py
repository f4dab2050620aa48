"""Everything that parses bytes from outside, as functions of bytes that may raise nothing else.

Each target holds what it may raise: the errors that its callers take and tell.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from config.errors import ConfigError
from config.scenarios import scenario_path
from config.settings import Settings
from config.sources import load_settings
from config.turbine import Site
from drivers.autopilot_state import VehicleState
from drivers.autopilot_wire import Received
from drivers.bad_file import BadFile
from drivers.bus import Ask
from drivers.bus_access import ALL_VERBS, LOCAL
from drivers.clock import MonotonicClock
from drivers.clouds.read import read_cloud
from drivers.codecs import (
    BadMessage,
    decode_frame,
    decode_points,
    decode_scan,
    encode_frame,
    encode_points,
    encode_scan,
)
from drivers.livox.frames import decode_frame as decode_control
from drivers.livox.frames import decode_key_values
from drivers.livox.packets import decode_imu, read_header
from drivers.livox.packets import decode_points as decode_returns
from mission.remote.desk import Desk
from mission.remote.history import History
from perception.values import Frame, Scan
from tests.faults.datagrams import _valid


@dataclass(frozen=True)
class Target:
    """A parser, what it may raise, and valid inputs to begin from."""

    name: str
    parse: Callable[[bytes], object]
    seeds: Callable[[], list[bytes]]
    raises: tuple[type[Exception], ...] = ()


def _livox(data: bytes) -> None:
    read_header(data, len(data))
    decode_imu(data)
    for kind in range(8):
        decode_returns(np.frombuffer(data, np.uint8)[None, :], kind)


def _control(data: bytes) -> None:
    frame = decode_control(data)
    if frame is not None:
        decode_key_values(frame.data)
    decode_key_values(data)


def _mavlink(data: bytes) -> None:
    """Take a message as MAVSDK hands it over: its name and its fields as JSON."""
    state = VehicleState(MonotonicClock())
    name = VehicleState.MESSAGES[data[0] % len(VehicleState.MESSAGES)] if data else "HEARTBEAT"
    state.take(Received.of(name, 1, data[1:], 1))
    state.reading()


@cache
def _desk() -> tuple[Desk, list[object]]:
    settings = Settings(
        missions_dir=tempfile.mkdtemp(prefix="bladescout-fuzz-"),
        sites=(Site(name="one", turbine="windpact-1.5"),),
    )
    intents: list[object] = []
    return Desk(settings, History(), intents.append, lambda _: None, {}), intents


def _request(data: bytes) -> None:
    """Ask each verb; nothing may be handed to flight, which is not there."""
    desk, intents = _desk()
    for verb in ALL_VERBS:
        reply = json.loads(desk.answer(Ask(verb, LOCAL, data)))
        assert isinstance(reply["ok"], bool)
        assert reply["code"]
    assert intents == []


def _settings(data: bytes) -> None:
    with tempfile.NamedTemporaryFile(suffix=".toml") as file:
        file.write(data)
        file.flush()
        load_settings([Path(file.name)], (), {})


def _cloud(ending: str) -> Callable[[bytes], None]:
    def parse(data: bytes) -> None:
        with tempfile.NamedTemporaryFile(suffix=ending) as file:
            file.write(data)
            file.flush()
            read_cloud(Path(file.name))

    return parse


def _scan() -> tuple[bytes, bytes]:
    points = np.random.default_rng(1).normal(0, 10, (50, 3)).astype(np.float32)
    nothing = np.zeros(50, np.uint8)
    return encode_scan(Scan(1.0, 1, points, np.zeros(50, np.float32), nothing, nothing, 0))


def _frame() -> tuple[bytes, bytes]:
    return encode_frame(Frame(1.0, 1, np.full((48, 64), 120, np.uint8)))


def _pcd() -> bytes:
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
    return (head + "POINTS 2\nDATA ascii\n1 2 3\n4 5 6\n").encode()


def _ply() -> bytes:
    head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
    return (head + "property float z\nend_header\n1 2 3\n4 5 6\n").encode()


_START = b'{"id":"a","site":"one","operator":"Ada","rotor_locked":true,"version":1}'
_POSITION = b'\x02{"time_boot_ms":100,"x":1.0,"y":2.0,"z":-3.0,"vx":0,"vy":0,"vz":0}'

TARGETS = (
    Target("livox packets", _livox, lambda: _valid(3, 0)),
    Target("livox control frames", _control, lambda: [bytes(64)]),
    # These are taken, counted and told by the link (drivers/autopilot_wire.py).
    Target("mavlink messages", _mavlink, lambda: [b"\x00{}", _POSITION],
           (ArithmeticError, LookupError, TypeError, ValueError)),
    Target("requests", _request, lambda: [_START, b'{"id":"x","version":1}']),
    Target("settings", _settings, lambda: [scenario_path("demo").read_bytes()], (ConfigError,)),
    Target("scans", lambda d: decode_scan(d, _scan()[1]), lambda: [_scan()[0]], (BadMessage,)),
    Target("a scan's attachment", lambda d: decode_scan(_scan()[0], d), lambda: [_scan()[1]],
           (BadMessage,)),
    Target("points", decode_points, lambda: [encode_points(np.zeros((9, 3), np.float32), 1.0)],
           (BadMessage,)),
    Target("pictures", lambda d: decode_frame(d, _frame()[1]), lambda: [_frame()[0]],
           (BadMessage,)),
    Target("PCD files", _cloud(".pcd"), lambda: [_pcd()], (BadFile,)),
    Target("PLY files", _cloud(".ply"), lambda: [_ply()], (BadFile,)),
    Target("NPZ files", _cloud(".npz"), lambda: [b"PK\x03\x04" + bytes(60)], (BadFile,)),
    Target("LVX2 files", _cloud(".lvx2"), lambda: [b"livox_tech\x00" + bytes(80)], (BadFile,)),
    Target("PCAP files", _cloud(".pcap"), lambda: [b"\xd4\xc3\xb2\xa1" + bytes(60)], (BadFile,)),
)  # fmt: skip
