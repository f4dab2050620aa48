"""The daemon's first process: starts the others, answers requests, never flies.

It owns the Zenoh router, validates each request and hands one intent at a time to flight.
"""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from pydantic import ValidationError

from config.settings import Settings
from drivers.bus import Bus, Key, Sample
from mission.flight.command import MissionState
from mission.flight.observation import RequestKind
from mission.processes.children import Child
from mission.processes.runtime import SETTINGS_FILE
from mission.remote.messages import (
    EventMessage,
    Intent,
    PlainRequest,
    Reply,
    StartRequest,
    StateMessage,
)

log = logging.getLogger(__name__)

MAX_REQUEST_BYTES = 64 * 1024
_PROCESSES = (
    ("recorder", "mission.processes.recorder"),
    ("sensing", "mission.processes.sensing"),
    ("flight", "mission.processes.flight"),
)
_BUSY = (MissionState.RUNNING, MissionState.PAUSED)
_WANTS_MISSION = {
    RequestKind.PAUSE,
    RequestKind.RESUME,
    RequestKind.SKIP,
    RequestKind.STOP,
    RequestKind.ABORT,
}


class Supervisor:
    """Requests in, intents out; keeps the newest state for late askers."""

    def __init__(self, settings: Settings, run_dir: Path) -> None:
        self._settings = settings
        self._run_dir = run_dir
        self._state: StateMessage | None = None
        self._started: dict[str, str] = {}
        self._pending: str | None = None
        self._bus: Bus | None = None
        self.ready = asyncio.Event()

    async def run(self, until: asyncio.Event) -> None:
        """Serve until told to end. Raises `drivers.bus.BusUnreachable` when the port is taken."""
        self._run_dir.mkdir(parents=True, exist_ok=True)
        (self._run_dir / SETTINGS_FILE).write_text(self._settings.model_dump_json())
        with Bus.open_router(self._settings.bus, self._settings.vehicle) as bus:
            self._bus = bus
            self._serve_requests(bus)
            bus.subscribe(Key.STATE, self._take_state)
            bus.announce()
            children = [Child(name, module, self._run_dir) for name, module in _PROCESSES]
            watchers = [asyncio.create_task(child.keep_alive(self._on_death)) for child in children]
            stop = asyncio.create_task(until.wait())
            await asyncio.wait([stop, *watchers], return_when=asyncio.FIRST_COMPLETED)
            # Flight leaves first, so that its last word (hold) goes out at once.
            *others, flight = children
            await flight.end()
            await asyncio.gather(*(child.end() for child in others))
            await asyncio.gather(*watchers)

    def _serve_requests(self, bus: Bus) -> None:
        bus.answer("rpc/start", self._guarded(self._start))
        bus.answer("rpc/status", self._guarded(self._status))
        bus.answer("rpc/turbines", self._guarded(self._turbines))
        for kind in _WANTS_MISSION:
            bus.answer(f"rpc/{kind}", self._guarded(partial(self._plain, kind)))

    def _guarded(self, handle: Callable[[bytes], Reply]) -> Callable[[bytes], bytes]:
        def answer(raw: bytes) -> bytes:
            if len(raw) > MAX_REQUEST_BYTES:
                reply = _refuse("too_large", f"a request is at most {MAX_REQUEST_BYTES} bytes")
            else:
                try:
                    reply = handle(raw)
                except ValidationError as error:
                    reply = _refuse("bad_request", _first_fault(error))
                except (ValueError, RecursionError) as error:
                    reply = _refuse("bad_request", f"the request is not valid JSON: {error}")
            return reply.model_dump_json().encode()

        return answer

    def _start(self, raw: bytes) -> Reply:
        request = StartRequest.model_validate_json(raw)
        if request.id in self._started:
            folder = self._started[request.id]
            return Reply(ok=True, code="already_started", text="started before", mission_dir=folder)
        if request.expires_utc_s is not None and time.time() > request.expires_utc_s:
            return _refuse("expired", "the request expired before it arrived")
        names = [site.name for site in self._settings.sites]
        if request.site not in names:
            known = ", ".join(names) or "none is configured"
            return _refuse("unknown_turbine", f"no turbine {request.site!r}; known: {known}")
        if not request.rotor_locked:
            return _refuse("not_confirmed", "confirm that the rotor is locked and yaw is off")
        if self._state is None:
            return _refuse("not_ready", "flight is not ready yet: try again in a second")
        if self._pending is not None or self._state.progress.state in _BUSY:
            return _refuse("busy", "a mission is running: abort it or wait for its end")
        if not self._state.link_ok:
            return _refuse("no_vehicle", self._state.progress.words)
        try:
            folder = str(self._new_folder(request.site))
        except OSError as error:
            return _refuse("no_folder", f"the mission folder cannot be made: {error}")
        inspection = self._settings.inspection
        intent = Intent(
            kind=RequestKind.START,
            id=request.id,
            site=request.site,
            operator=request.operator,
            rotor_locked=request.rotor_locked,
            blades=request.blades or inspection.blades,
            sides=request.sides or inspection.sides,
            mission_dir=folder,
        )
        self._started[request.id] = self._pending = folder
        self._hand_over(intent)
        return Reply(ok=True, code="started", text="mission started", mission_dir=folder)

    def _new_folder(self, site: str) -> Path:
        stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        root = Path(self._settings.missions_dir).resolve()
        folder, count = root / f"{stamp}-{site}", 1
        while folder.exists():
            count += 1
            folder = root / f"{stamp}-{site}-{count}"
        folder.mkdir(parents=True)
        return folder

    def _plain(self, kind: RequestKind, raw: bytes) -> Reply:
        request = PlainRequest.model_validate_json(raw)
        if self._state is None or (
            self._pending is None and self._state.progress.state not in _BUSY
        ):
            return _refuse("not_running", f"no mission is running: nothing to {kind}")
        self._hand_over(Intent(kind=kind, id=request.id))
        return Reply(ok=True, code="accepted", text=f"{kind} handed to flight", state=self._state)

    def _status(self, raw: bytes) -> Reply:
        PlainRequest.model_validate_json(raw)
        if self._state is None:
            return Reply(ok=True, code="starting", text="flight is not ready yet")
        return Reply(
            ok=True,
            code="ok",
            text=self._state.progress.words,
            mission_dir=self._state.mission_dir,
            state=self._state,
        )

    def _turbines(self, raw: bytes) -> Reply:
        PlainRequest.model_validate_json(raw)
        text = json.dumps([site.model_dump() for site in self._settings.sites])
        return Reply(ok=True, code="ok", text=text)

    def _hand_over(self, intent: Intent) -> None:
        assert self._bus is not None  # noqa: S101 - requests arrive only while the bus is open
        self._bus.publish(Key.INTENT, intent.model_dump_json().encode())

    def _take_state(self, sample: Sample) -> None:
        self._state = StateMessage.model_validate_json(sample.payload)
        self.ready.set()
        if self._pending is not None and self._state.mission_dir == self._pending:
            self._pending = None

    def _on_death(self, name: str, deaths: int) -> None:
        if name == "flight":
            self._pending = None
        if self._bus is not None:
            event = EventMessage(
                mission_s=0.0,
                name=f"{name}_died",
                severity="hold",
                text=f"the {name} process died ({deaths} times within a minute)",
            )
            self._bus.publish(Key.EVENT, event.model_dump_json().encode())


def _refuse(code: str, text: str) -> Reply:
    return Reply(ok=False, code=code, text=text)


def _first_fault(error: ValidationError) -> str:
    fault = error.errors()[0]
    where = ".".join(str(part) for part in fault["loc"]) or "request"
    return f"{where}: {fault['msg']}"
