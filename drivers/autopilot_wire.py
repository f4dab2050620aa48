"""MAVLink messages and commands through MAVSDK, bound to one system id.

Everything goes through MAVSDK's direct message access: it answers on the caller's thread within
a tenth of a millisecond, keeps the senders' own time stamps, and leaves no call hanging in a
thread that would have to be waited for at the end. Commands are acknowledged and repeated here,
so that the number of tries is ours and ends the moment that the caller no longer wants it.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import math
import socket
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

from mavsdk import Configuration, LogLevel, Mavsdk, MavsdkError, System, log_subscribe
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage

from drivers.autopilot_errors import LinkFailed, NoVehicle, PortTaken, Refused, Unanswered
from drivers.autopilot_tap import open_tap

_log = logging.getLogger(__name__)
_native_log = logging.getLogger("mavsdk")

_Result = TypeVar("_Result")

OWN_COMPONENT = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER. Our system id is the vehicle's, as of every part of it: by it
routers and ground stations tell one vehicle's computer from another's."""

_LEVELS = {
    LogLevel.DEBUG: logging.DEBUG,
    # MAVSDK tells at these levels what is ours to judge and to tell.
    LogLevel.INFO: logging.DEBUG,
    LogLevel.WARN: logging.DEBUG,
    LogLevel.ERROR: logging.INFO,
}
_RESULTS = {
    1: "temporarily rejected",
    2: "denied",
    3: "not supported",
    4: "failed",
    6: "cancelled",
}
_ACCEPTED, _TEMPORARILY_REJECTED, _IN_PROGRESS = 0, 1, 5
_COMMAND_TRIES = 3
_ACK_TIMEOUT_S = 0.6
_PROGRESS_TIMEOUT_S, _PROGRESS_MOST_S = 5.0, 30.0


@dataclass(frozen=True, slots=True)
class Received:
    """One message as it came in."""

    name: str
    component_id: int
    fields: Mapping[str, object]
    arrival_ns: int

    @classmethod
    def of(
        cls, name: str, component_id: int, fields_json: str | bytes, arrival_ns: int
    ) -> Received:
        """Return a message as MAVSDK hands it over; raises `ValueError` where that is no object."""
        fields = json.loads(fields_json)
        if not isinstance(fields, dict):
            raise ValueError(f"{name}: its fields are no object")  # noqa: TRY004 - bad data
        return cls(name, component_id, fields, arrival_ns)

    def number(self, key: str) -> float:
        """Return a numeric field; NaN where it is absent or NaN on the wire."""
        value = self.fields.get(key)
        return float(value) if isinstance(value, (int, float)) else math.nan

    def integer(self, key: str, default: int = 0) -> int:
        """Return an integer field, or the default where it is absent."""
        value = self.fields.get(key)
        return value if isinstance(value, int) else default

    def numbers(self, key: str) -> tuple[float, ...]:
        """Return an array field."""
        value = self.fields.get(key)
        if not isinstance(value, list):
            return ()
        return tuple(float(x) if isinstance(x, (int, float)) else math.nan for x in value)

    def text(self, key: str) -> str:
        """Return a text field."""
        value = self.fields.get(key)
        return value if isinstance(value, str) else ""


Listener = Callable[[Received], None]


def _take_log(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
    _native_log.log(_LEVELS.get(level, logging.DEBUG), "%s", message)
    return True


def check_url(url: str) -> None:
    """Raise `PortTaken` or `LinkFailed` where a URL cannot be listened on or opened.

    Binding a UDP port that another instance has bound succeeds silently in MAVSDK and takes the
    link away from the other: so it is tried here, without address reuse, first.
    """
    parts = urlsplit(url)
    if parts.scheme == "serial":
        device = url.removeprefix("serial://").rsplit(":", 1)[0]
        if not Path(device).exists():
            raise LinkFailed(f"{url}: there is no serial device {device}")
        return
    if parts.scheme not in ("udpin", "tcpin"):
        return
    kind = socket.SOCK_DGRAM if parts.scheme == "udpin" else socket.SOCK_STREAM
    with socket.socket(socket.AF_INET, kind) as trial:
        try:
            trial.bind((parts.hostname or "0.0.0.0", parts.port or 0))  # noqa: S104 - as MAVSDK does
        except OSError as error:
            if error.errno in (98, 48, 10048):  # EADDRINUSE of Linux, macOS, Windows
                raise PortTaken(
                    f"{url}: port {parts.port} is taken by another process on this computer"
                ) from error
            raise LinkFailed(f"{url}: {error.strerror or error}") from error


class Wire:
    """One MAVSDK instance; sends to, and hears from, one system id only."""

    def __init__(
        self, mavsdk: Mavsdk, system: System, system_id: int, folders_before: frozenset[Path]
    ) -> None:
        self._mavsdk = mavsdk
        self._system = system
        self._direct = MavlinkDirect(system)
        self.system_id = system_id
        self._loop = asyncio.get_running_loop()
        self._waiting: dict[tuple[int, int], asyncio.Queue[int]] = {}
        self._turns: dict[tuple[int, int], asyncio.Lock] = {}
        self._calls = ThreadPoolExecutor(2, thread_name_prefix="mavsdk-call")
        self._running: set[asyncio.Future[Any]] = set()
        self._closed = False
        self._folders_before = folders_before
        self.listen("COMMAND_ACK", self._take_ack)

    @classmethod
    async def open(
        cls, urls: Sequence[str], system_id: int, timeout_s: float, tap_file: Path | None = None
    ) -> Wire:
        """Open every URL and wait (wall time) for the autopilot with our system id.

        ``tap_file``: where to tell on which port the raw link can be heard (`autopilot_tap`).
        """
        for url in urls:
            check_url(url)
        log_subscribe(_take_log)
        folders = _metadata_folders()
        mavsdk = Mavsdk(Configuration.create_manual(system_id, OWN_COMPONENT, True))
        try:
            for url in urls:
                try:
                    await _to_its_end(partial(mavsdk.add_any_connection_with_handle, url))
                except (MavsdkError, ConnectionError) as error:
                    raise LinkFailed(f"{url}: {error}") from error
            system = await _find(mavsdk, urls[0], system_id, timeout_s)
            if tap_file is not None:
                await _to_its_end(partial(open_tap, mavsdk, tap_file))
        except BaseException:
            mavsdk.destroy()
            _remove_new(folders)
            raise
        return cls(mavsdk, system, system_id, folders)

    def listen(self, name: str, listener: Listener, component_id: int | None = None) -> None:
        """Call ``listener``, on MAVSDK's thread, with every message of that name from our system.

        ``component_id``: hear only this component; None hears all of them.
        """

        def take(message: MavlinkMessage, _: object) -> None:
            if message.system_id != self.system_id:
                return
            if component_id is not None and message.component_id != component_id:
                return
            arrival_ns = time.monotonic_ns()
            try:
                component = int(message.component_id)
                listener(Received.of(name, component, message.fields_json, arrival_ns))
            except (ArithmeticError, LookupError, TypeError, ValueError):
                # Whatever a damaged message holds, MAVSDK's thread goes on.
                _log.warning("%s not understood: %.200s", name, message.fields_json)

        self._direct.subscribe_message(name, take)

    def send(self, name: str, fields: str, component_id: int = 1) -> None:
        """Send one message now, from the calling thread. ``fields``: JSON, null for NaN."""
        if self._closed:
            raise LinkFailed("the link to the vehicle is closed")
        try:
            self._direct.send_message(
                MavlinkMessage(name, 0, 0, self.system_id, component_id, fields)
            )
        except MavsdkError as error:
            raise LinkFailed(f"{name} was not sent: {error}") from error

    async def command(
        self,
        what: str,
        command: int,
        parameters: Sequence[float | None],
        component_id: int = 1,
        tries: int = _COMMAND_TRIES,
        wanted: Callable[[], bool] | None = None,
    ) -> None:
        """Send a COMMAND_LONG until it is acknowledged; `Refused` says why it was not done.

        `Unanswered`, which is one: not once did an acknowledgement come.

        ``parameters``: up to seven; None is NaN ("as you see fit"). ``wanted`` is asked before
        each repetition: where it says no, nothing more is sent.
        """
        key = (command, component_id)
        reason = "no acknowledgement"
        refusal: type[Refused] = Unanswered
        for attempt in range(tries):
            if attempt and wanted is not None and not wanted():
                raise refusal(f"{what}: {reason}; no longer wanted")
            result = await self._try_command(key, parameters, attempt)
            if result == _ACCEPTED:
                return
            if result is not None:
                reason, refusal = _RESULTS.get(result, f"result {result}"), Refused
                if result != _TEMPORARILY_REJECTED:
                    raise Refused(f"{what}: {reason}")
                await asyncio.sleep(0.2)
        raise refusal(f"{what}: {reason} after {tries} tries")

    async def _try_command(
        self, key: tuple[int, int], parameters: Sequence[float | None], attempt: int
    ) -> int | None:
        """Send once; return the result, or None when no acknowledgement came."""
        command, component_id = key
        fields: dict[str, float | None] = {
            "target_system": self.system_id,
            "target_component": component_id,
            "command": command,
            "confirmation": attempt,
        }
        fields |= {f"param{i + 1}": value for i, value in enumerate(parameters)}
        # One at a time: an acknowledgement does not say which of two equal commands it is of.
        async with self._turns.setdefault(key, asyncio.Lock()):
            answers: asyncio.Queue[int] = asyncio.Queue()
            self._waiting[key] = answers
            try:
                self.send("COMMAND_LONG", json.dumps(fields), component_id)
                async with asyncio.timeout(_PROGRESS_MOST_S):
                    result = await asyncio.wait_for(answers.get(), _ACK_TIMEOUT_S)
                    # The end may follow at once.
                    while result == _IN_PROGRESS:
                        result = await asyncio.wait_for(answers.get(), _PROGRESS_TIMEOUT_S)
            except TimeoutError:
                return None
            else:
                return result
            finally:
                del self._waiting[key]

    def _take_ack(self, ack: Received) -> None:
        # Zero: a vehicle that does not say whom it answers.
        if ack.integer("target_component") not in (0, OWN_COMPONENT):
            return
        key = (ack.integer("command"), ack.component_id)
        with contextlib.suppress(RuntimeError):  # the loop is gone: nobody waits any more
            self._loop.call_soon_threadsafe(self._settle, key, ack.integer("result"))

    def _settle(self, key: tuple[int, int], result: int) -> None:
        answers = self._waiting.get(key)
        if answers is not None:
            answers.put_nowait(result)

    def plugin_system(self) -> System:
        """Return the MAVSDK system, for a plugin of its own (parameters)."""
        return self._system

    async def call(self, function: Callable[[], _Result]) -> _Result:
        """Run a blocking MAVSDK call in a thread; `close` waits for it, as it must."""
        if self._closed:
            raise LinkFailed("the link to the vehicle is closed")
        future = self._loop.run_in_executor(self._calls, function)
        self._running.add(future)
        future.add_done_callback(self._ended)
        return await asyncio.shield(future)

    def _ended(self, call: asyncio.Future[Any]) -> None:
        self._running.discard(call)
        if not call.cancelled():
            call.exception()  # looked at: who asked may be gone, and then nobody minds

    async def close(self) -> None:
        """Let go of the vehicle; nothing is sent any more."""
        if self._closed:
            return
        self._closed = True
        # Destroying MAVSDK under a call in flight would hang that call's thread for ever.
        if self._running:
            await asyncio.wait(self._running)
        self._calls.shutdown(wait=False)
        await self._loop.run_in_executor(None, self._mavsdk.destroy)
        _remove_new(self._folders_before)


async def _to_its_end(call: Callable[[], object]) -> None:
    """Make a blocking MAVSDK call in a thread; who is cancelled meanwhile goes when it is over.

    Destroying MAVSDK under a call in flight would hang that call's thread for ever.
    """
    made = asyncio.get_running_loop().run_in_executor(None, call)
    try:
        await asyncio.shield(made)
    except asyncio.CancelledError:
        with contextlib.suppress(MavsdkError, OSError):
            await made
        raise


def _metadata_folders() -> frozenset[Path]:
    return frozenset(Path(tempfile.gettempdir()).glob("mavsdk-component-metadata-*"))


def _remove_new(before: frozenset[Path]) -> None:
    """Remove the empty folder that MAVSDK leaves behind at each start."""
    for folder in _metadata_folders() - before:
        with contextlib.suppress(OSError):
            folder.rmdir()


async def _find(mavsdk: Mavsdk, url: str, system_id: int, timeout_s: float) -> System:
    deadline_s = time.monotonic() + timeout_s
    heard: set[int] = set()
    while True:
        for system in mavsdk.get_systems():
            heard.add(int(system.get_system_id()))
            if system.get_system_id() == system_id and system.has_autopilot():
                return system
        if time.monotonic() >= deadline_s:
            others = ", ".join(str(i) for i in sorted(heard - {system_id}))
            remedy = (
                f"heard system id {others}: is autopilot.system_id right?"
                if others
                else "check its power and wiring, and autopilot.url"
            )
            raise NoVehicle(
                f"no vehicle with system id {system_id} answered on {url} "
                f"within {timeout_s:g} s; {remedy}"
            )
        await asyncio.sleep(0.05)
