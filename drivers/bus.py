"""The Zenoh bus: sensor data, estimates and state between processes, requests from afar.

Processes of this computer meet over loopback; everyone else comes by TLS with a certificate of the
site, and may do what `drivers.bus_access` says.

Publishing never blocks the caller: one thread per session puts in order, and where the network
does not keep up the oldest sensor data is dropped and counted. Subscriptions hand their samples
to the event loop (or call straight back where there is no loop).
"""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

import zenoh

from config.links import Bus as BusSettings
from drivers.bus_access import LOCAL
from drivers.bus_session import client_config, router_config
from drivers.request_rate import RequestRate

log = logging.getLogger(__name__)

#: More than this many messages waiting: sensor data is dropped, oldest first.
MAX_WAITING = 512
MAX_REQUEST_BYTES = 64 * 1024
#: Asked for in a bucket of their own, so that no flood of other requests delays them.
_URGENT = frozenset({"pause", "stop", "abort"})


class Key(StrEnum):
    """Keys below ``bladescout/<vehicle>/`` (design, Bus keys)."""

    SCAN = "sensor/lidar/scan"
    FRAME = "sensor/camera/frame"
    VEHICLE = "vehicle/state"
    CLEARANCE = "perception/clearance"
    OCCUPANCY = "perception/occupancy"
    HUB_PRIOR = "perception/hub_prior"
    ROTOR = "perception/rotor"
    BLADE = "perception/blade"
    EXPOSURE = "perception/exposure"
    METERING = "perception/metering"
    SENSING = "perception/health"
    READY = "perception/ready"
    TAKEN = "perception/taken"
    STATE = "mission/state"
    EVENT = "mission/event"
    COMMAND = "mission/command"
    TASK = "mission/task"
    INTENT = "mission/intent"
    RECORD = "mission/record"
    EARLIER = "mission/earlier"
    JOURNAL = "mission/journal"
    PLAN = "mission/plan"
    PHOTO = "mission/photo"
    PHOTO_RESULT = "mission/photo_result"
    REPORT = "mission/report"
    RECORDED = "mission/recorded"
    ALIVE = "alive"


@dataclass(frozen=True, slots=True)
class Sample:
    """One message as it came."""

    key: str
    """Below ``bladescout/<vehicle>/``."""
    payload: bytes
    attachment: bytes | None
    vehicle: str = ""


@dataclass(frozen=True, slots=True)
class Ask:
    """One request as it came."""

    verb: str
    who: str
    """Name of the certificate that asks, as the router has let it in; `LOCAL` over loopback."""
    payload: bytes
    """At most one byte more than `MAX_REQUEST_BYTES`."""


class BusUnreachable(ConnectionError):
    """Nobody answers at the bus's end point, or it cannot be opened there."""


class Bus:
    """One session on the bus, below the keys of one vehicle."""

    def __init__(
        self, session: zenoh.Session, vehicle: str, loop: asyncio.AbstractEventLoop | None
    ):
        self._session = session
        self._prefix = f"bladescout/{vehicle}/"
        self._loop = loop
        self._waiting: deque[tuple[str, bytes, str, bytes | None, bool]] = deque()
        self._wake = threading.Condition()
        self._closing = False
        self._keep: list[object] = []
        self.dropped = 0
        self._thread = threading.Thread(target=self._put_waiting, name="bus-put", daemon=True)
        self._thread.start()

    @classmethod
    def open_router(cls, settings: BusSettings, vehicle: str) -> Self:
        """Open the router that all others connect to. Call with a running event loop.

        Raises `BusUnreachable`, `drivers.bus_session.BusNotSafe` or `drivers.bus_access.BadRoles`.
        """
        return cls._open(router_config(settings), settings.listen, vehicle)

    @classmethod
    def open_client(cls, settings: BusSettings, vehicle: str) -> Self:
        """Connect to the router, with or without a running event loop.

        ``vehicle``: a name, or ``*`` for all. Raises `BusUnreachable` or
        `drivers.bus_session.BusNotSafe`.
        """
        return cls._open(client_config(settings), settings.endpoint, vehicle)

    @classmethod
    def _open(cls, config: zenoh.Config, endpoint: str, vehicle: str) -> Self:
        try:
            session = zenoh.open(config)
        except zenoh.ZError as error:
            raise BusUnreachable(f"no bus at {endpoint}: {error}") from error
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            loop = None
        return cls(session, vehicle, loop)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def session(self) -> zenoh.Session:
        """The Zenoh session itself, for measuring."""
        return self._session

    def close(self) -> None:
        """Send what waits (for at most a second) and leave the bus."""
        with self._wake:
            self._closing = True
            self._wake.notify()
        self._thread.join(timeout=1.0)
        self._session.close()

    def publish(
        self,
        key: str,
        payload: bytes,
        *,
        encoding: str = "application/json",
        attachment: bytes | None = None,
        droppable: bool = False,
    ) -> None:
        """Queue a message; `droppable` ones (sensor data) give way when the queue is full."""
        with self._wake:
            if len(self._waiting) >= MAX_WAITING and not self._make_room():
                self.dropped += 1
                return
            self._waiting.append((key, payload, encoding, attachment, droppable))
            self._wake.notify()

    def _make_room(self) -> bool:
        for index, item in enumerate(self._waiting):
            if item[4]:
                del self._waiting[index]
                self.dropped += 1
                return True
        return False

    def _put_waiting(self) -> None:
        while True:
            with self._wake:
                while not self._waiting:
                    if self._closing:
                        return
                    self._wake.wait()
                key, payload, encoding, attachment, _ = self._waiting.popleft()
            try:
                self._session.put(
                    self._prefix + key,
                    payload,
                    encoding=encoding,
                    congestion_control=zenoh.CongestionControl.BLOCK,
                    attachment=attachment,
                    express=True,
                )
            except zenoh.ZError as error:
                self.dropped += 1
                log.error("not published on %s: %s", key, error)

    def subscribe(self, key: str, on_sample: Callable[[Sample], None]) -> None:
        """Call back with every sample of a key (`**` for all), in order."""
        self.follow(key, on_sample)

    def follow(
        self, key: str, on_sample: Callable[[Sample], None], vehicle: str = ""
    ) -> Callable[[], None]:
        """Call back with every sample of a key until the returned function is called.

        ``vehicle``: whose, where the session was opened for all.
        """

        def receive(sample: zenoh.Sample) -> None:
            self._deliver(on_sample, self._sample(sample))

        prefix = f"bladescout/{vehicle}/" if vehicle else self._prefix
        subscriber = self._session.declare_subscriber(prefix + key, receive)
        self._keep.append(subscriber)

        def end() -> None:
            self._keep.remove(subscriber)
            subscriber.undeclare()

        return end

    def subscribe_newest(self, key: str, on_sample: Callable[[Sample], None]) -> None:
        """Call back with the newest sample only: a slow reader never sees old ones."""
        lock = threading.Lock()
        newest: list[Sample] = []

        def hand_over() -> None:
            with lock:
                sample = newest.pop()
            on_sample(sample)

        def receive(raw: zenoh.Sample) -> None:
            sample = self._sample(raw)
            with lock:
                pending = bool(newest)
                newest[:] = [sample]
            if not pending:
                self._call(hand_over)

        self._keep.append(self._session.declare_subscriber(self._prefix + key, receive))

    def answer_requests(
        self,
        verbs: Sequence[str],
        on_request: Callable[[Ask], bytes],
        *,
        per_s: float,
        too_many: bytes,
    ) -> None:
        """Answer requests on ``rpc/<verb>`` and ``rpc/<verb>/<name>``, each with one reply.

        The callback runs on the loop. A client that asks more often than ``per_s`` gets
        ``too_many`` at once and does not reach it.
        """
        rate = RequestRate(per_s)

        def reply(query: zenoh.Query, ask: Ask) -> None:
            with query:
                query.reply(query.key_expr, on_request(ask), encoding="application/json")

        def receive(query: zenoh.Query) -> None:
            asker = self._asker(query)
            if asker is None:
                query.drop()
                return
            verb, who, client = asker
            # The rate comes first: a flood is not worth looking at what it carries.
            if not rate.allows(client, time.monotonic()):
                with query:
                    query.reply(query.key_expr, too_many, encoding="application/json")
                return
            payload = b"" if query.payload is None else query.payload.to_bytes()
            ask = Ask(verb, who, bytes(payload[: MAX_REQUEST_BYTES + 1]))
            self._call(lambda: reply(query, ask))

        for verb in verbs:
            key = f"{self._prefix}rpc/{verb}/**"
            self._keep.append(self._session.declare_queryable(key, receive))

    def _asker(self, query: zenoh.Query) -> tuple[str, str, str] | None:
        """Return verb, name, and the client whose rate it counts for; None: not for one of us."""
        key = str(query.key_expr).removeprefix(self._prefix)
        _, *words = key.split("/")
        if "*" in key or not 1 <= len(words) <= 2:
            return None
        verb, who = words[0], words[1] if len(words) == 2 else LOCAL
        # Over loopback the clients tell themselves apart.
        own = query.attachment if who == LOCAL else None
        client = who if own is None else f"{who} {own.to_bytes()[:32]!r}"
        if verb in _URGENT:
            client = f"{client} urgent"
        return verb, who, client

    def request(
        self, key: str, payload: bytes, timeout_s: float = 3.0, vehicle: str = ""
    ) -> bytes | None:
        """Ask and wait (blocking); None when nobody answers.

        ``vehicle``: whom, where the session was opened for all.
        """
        prefix = f"bladescout/{vehicle}/" if vehicle else self._prefix
        replies = self._session.get(
            prefix + key,
            payload=payload,
            timeout=timeout_s,
            encoding="application/json",
            attachment=str(self._session.zid()).encode(),
        )
        for reply in replies:
            if reply.ok is not None:
                return bytes(reply.ok.payload.to_bytes())
        return None

    def alive(self, timeout_s: float = 1.0) -> tuple[str, ...]:
        """Return the names of all vehicles at the router whose daemons are up (blocking)."""
        replies = self._session.liveliness().get(f"bladescout/*/{Key.ALIVE}", timeout=timeout_s)
        found = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
        return tuple(sorted(name.split("/")[1] for name in found))

    def announce(self) -> None:
        """Declare the liveliness token of this vehicle."""
        self._keep.append(self._session.liveliness().declare_token(self._prefix + Key.ALIVE))

    def _sample(self, sample: zenoh.Sample) -> Sample:
        attachment = sample.attachment
        _, vehicle, key = str(sample.key_expr).split("/", 2)
        return Sample(
            key,
            bytes(sample.payload.to_bytes()),
            None if attachment is None else bytes(attachment.to_bytes()),
            vehicle,
        )

    def _deliver(self, on_sample: Callable[[Sample], None], sample: Sample) -> None:
        self._call(lambda: on_sample(sample))

    def _call(self, function: Callable[[], None]) -> None:
        if self._loop is None:
            function()
        elif not self._loop.is_closed():
            self._loop.call_soon_threadsafe(function)
