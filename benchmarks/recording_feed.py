"""A recorder as it runs on a drone, in its own process, fed over the bus as a whole flight would.

The rates and sizes are those of the table of flows in ARCHITECTURE.md, but for the LiDAR, which is
at what a MID-360 gives at most: 20 000 returns in each scan, 200 k a second; and the vehicle's link
as bytes, 200 messages a second.
"""

from __future__ import annotations

import asyncio
import itertools
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import psutil
from pydantic import TypeAdapter

from config.links import Bus as BusSettings
from config.settings import Settings
from config.turbine import Site
from drivers.autopilot_tap import TAP_FILE
from drivers.bus import Bus, Key
from drivers.codecs import encode_frame, encode_points, encode_scan
from drivers.free_port import free_port
from mission.flight.observation import BladeTrack, FlightMode, GimbalState, RequestKind, Vehicle
from mission.processes.runtime import SETTINGS_FILE
from mission.remote.messages import Intent, ReadyMessage, VehicleMessage
from perception.values import Frame, Scan

RETURNS = 20_000
#: A key of our own: each message of it tells when it was sent.
PROBE = "probe"
TICK_S = 0.05
_LINK_PER_TICK = 10
_START_S = 60.0


class FedRecorder:
    """A recorder process, the router it talks to, and everything it records. A context manager."""

    def __init__(self, folder: Path, *, full: bool = True) -> None:
        """``full``: sensors at full rate; else only what tells when it was sent."""
        self._folder = folder
        self._full = full
        self.run_dir = folder / "run"
        self.run_dir.mkdir(parents=True)
        self.settings = Settings(
            bus=BusSettings(listen=f"tcp/127.0.0.1:{free_port()}"),
            sites=(Site(name="fed", turbine="windpact-1.5"),),
        )
        (self.run_dir / SETTINGS_FILE).write_text(self.settings.model_dump_json())
        self._link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._link.bind(("127.0.0.1", 0))
        self._link.setblocking(False)
        (self.run_dir / TAP_FILE).write_text(f"{self._link.getsockname()[1]}\n")
        self._listener: tuple[str, int] | None = None
        self._bus: Bus | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._recording = ""
        self._messages = _Messages()

    async def __aenter__(self) -> Self:
        self._bus = Bus.open_router(self.settings.bus, self.settings.vehicle)
        self._bus.subscribe(Key.READY, lambda sample: self._take_ready(sample.payload))
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.kill()
        self._link.close()
        if self._bus is not None:
            self._bus.close()

    def _take_ready(self, payload: bytes) -> None:
        ready = ReadyMessage.model_validate_json(payload)
        if ready.name == "recorder":
            self._recording = ready.recording or "nothing"

    async def start(self, folder: Path) -> psutil.Process:
        """Start a recorder and have it record a mission into a folder; return its process."""
        assert self._bus is not None
        process = self._spawn(folder)
        intent = Intent(kind=RequestKind.START, id="1", site="fed", mission_dir=str(folder))
        async with asyncio.timeout(_START_S):
            while self._recording != str(folder):
                if self._recording:
                    self._bus.publish(Key.RECORD, intent.model_dump_json().encode())
                await asyncio.sleep(0.05)
        return psutil.Process(process.pid)

    def _spawn(self, folder: Path) -> subprocess.Popen[bytes]:
        folder.mkdir(parents=True, exist_ok=True)
        self._recording = ""
        command = [sys.executable, "-m", "mission.processes.recorder", str(self.run_dir)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE)
        return self._process

    def kill(self) -> None:
        """Kill the recorder; nothing is left to it."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            if self._process.stdin is not None:
                self._process.stdin.close()
            self._process = None

    async def feed(self, seconds: float) -> None:
        """Publish everything at its rate for so long, by the wall clock."""
        begun_s = time.monotonic()
        for tick in itertools.count():
            due_s = begun_s + tick * TICK_S
            if due_s - begun_s >= seconds:
                return
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))
            self._tick(tick)

    def _tick(self, tick: int) -> None:
        assert self._bus is not None
        bus, made = self._bus, self._messages
        bus.publish(PROBE, b'{"at": %d}' % time.monotonic_ns())
        if not self._full:
            return
        bus.publish(Key.COMMAND, made.tick)
        bus.publish(Key.VEHICLE, made.vehicle)
        if tick % 2:
            bus.publish(Key.SCAN, made.scan, attachment=made.attachment, droppable=True)
            bus.publish(Key.OCCUPANCY, made.occupancy, droppable=True)
            bus.publish(Key.CLEARANCE, made.clearance)
            bus.publish(Key.BLADE, made.blade)
        bus.publish(Key.FRAME, made.frame, droppable=True)
        with suppress(BlockingIOError):
            self._listener = self._link.recvfrom(1024)[1]
        for _ in range(_LINK_PER_TICK if self._listener else 0):
            assert self._listener is not None
            self._link.sendto(made.link, self._listener)


class _Messages:
    """One message of each kind, of the size that it has in flight."""

    def __init__(self) -> None:
        draw = np.random.default_rng(1)
        points = draw.uniform(2, 40, (RETURNS, 3)).astype(np.float32)
        scan = Scan(
            stamp_s=1.0,
            sequence=7,
            points_l=points,
            age_s=np.linspace(0.1, 0, RETURNS, dtype=np.float32),
            reflectivity=draw.integers(0, 255, RETURNS).astype(np.uint8),
            tag=np.zeros(RETURNS, np.uint8),
            lost_packets=0,
        )
        self.scan, self.attachment = encode_scan(scan)
        grey = draw.normal(130, 20, (270, 480)).clip(0, 255).astype(np.uint8)
        self.frame = encode_frame(Frame(1.0, 1, grey))[0]
        self.occupancy = encode_points(points[:1150], 1.0)
        self.tick = b'{"observation": "' + b"0.123456789 " * 350 + b'"}'
        vehicle = Vehicle(
            1.0, (3.0, -4.0, 50.0), (0.1, 0.2, 0.0), (1.0, 0.0, 0.0, 0.0), 0.0,
            FlightMode.OFFBOARD, 1.0, True, True, False, 1.0,
            latitude_deg=54.0, longitude_deg=6.5, altitude_m=70.0,
        )  # fmt: skip
        state = VehicleMessage(vehicle=vehicle, gimbal=GimbalState(1.0, 1.2, -0.1))
        self.vehicle = state.model_dump_json().encode()
        self.clearance = b'{"stamp_s": 1.0, "sequence": 7, "nearest_m": 11.5, "rate_hz": 10.0}'
        place, along = (1.0, 2.0, 3.0), (0.0, 0.0, 1.0)
        track = BladeTrack(1.0, "A", place, along, 12.0, 500.0, (0.0, 0.0, 0.0), 0.1)
        self.blade = TypeAdapter(BladeTrack).dump_json(track)
        # A frame of MAVLink 2 with 44 bytes of payload, as they are on average.
        self.link = bytes([0xFD, 44, 0, 0, 1, 1, 1, 30, 0, 0]) + bytes(46)
