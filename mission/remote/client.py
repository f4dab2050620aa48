"""Talk to a daemon from anywhere: start a mission, watch it, end it."""

from __future__ import annotations

import logging
import socket
import uuid
from collections.abc import Callable
from types import TracebackType
from typing import Self, TypeVar

from pydantic import ValidationError

from config.links import Bus as BusSettings
from drivers.bus import Bus, BusUnreachable, Key, Sample
from mission.flight.observation import RequestKind
from mission.remote.messages import (
    EventMessage,
    Message,
    PlainRequest,
    RecordedMessage,
    Reply,
    StartRequest,
    StateMessage,
)

log = logging.getLogger(__name__)

Heard = TypeVar("Heard", bound=Message)
_PROBE_S = 3.0


class NoReply(ConnectionError):
    """Nobody answered: the daemon is not running, or we are not authorised."""


class Client:
    """A blocking client of one vehicle's daemon.

    ``Client("drone-1").start("demo-1", operator="Ada", rotor_locked=True)``
    """

    def __init__(self, vehicle: str = "drone-1", bus: BusSettings | None = None) -> None:
        """Connect. Raises `drivers.bus.BusUnreachable` when nobody listens there."""
        settings = bus or BusSettings()
        _probe(settings.endpoint)
        self._bus = Bus.open_client(settings, vehicle)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the bus."""
        self._bus.close()

    def start(
        self,
        site: str,
        *,
        operator: str,
        rotor_locked: bool,
        request_id: str | None = None,
        blades: tuple[str, ...] | None = None,
        sides: tuple[str, ...] | None = None,
    ) -> Reply:
        """Start a mission; `rotor_locked` is the operator's word. Raises `NoReply`."""
        request = StartRequest.model_validate(
            {
                "id": request_id or uuid.uuid4().hex,
                "site": site,
                "operator": operator,
                "rotor_locked": rotor_locked,
                "blades": blades,
                "sides": sides,
            }
        )
        return self._ask("rpc/start", request.model_dump_json())

    def status(self) -> Reply:
        """Return how the mission stands. Raises `NoReply`."""
        return self._plain("status")

    def pause(self) -> Reply:
        """Hold where the vehicle is; `resume` goes on. Raises `NoReply`."""
        return self._plain(RequestKind.PAUSE)

    def resume(self) -> Reply:
        """Go on after a pause. Raises `NoReply`."""
        return self._plain(RequestKind.RESUME)

    def skip(self) -> Reply:
        """Leave out the rest of the pass that is flown. Raises `NoReply`."""
        return self._plain(RequestKind.SKIP)

    def stop(self) -> Reply:
        """Hold and hand the vehicle to the pilot. Raises `NoReply`."""
        return self._plain(RequestKind.STOP)

    def abort(self) -> Reply:
        """Hold at once, leave the rotor, return. Raises `NoReply`."""
        return self._plain(RequestKind.ABORT)

    def watch(
        self,
        on_state: Callable[[StateMessage], None],
        on_event: Callable[[EventMessage], None] | None = None,
        on_recorded: Callable[[RecordedMessage], None] | None = None,
    ) -> None:
        """Call back with every state and event from now on (on the bus's thread)."""
        self._hear(Key.STATE, StateMessage, on_state)
        if on_event is not None:
            self._hear(Key.EVENT, EventMessage, on_event)
        if on_recorded is not None:
            self._hear(Key.RECORDED, RecordedMessage, on_recorded)

    def _hear(self, key: Key, kind: type[Heard], tell: Callable[[Heard], None]) -> None:
        def take(sample: Sample) -> None:
            try:
                message = kind.model_validate_json(sample.payload)
            except ValidationError as error:
                log.warning("%s was not understood: %s", key, error)
                return
            tell(message)

        self._bus.subscribe(key, take)

    def _plain(self, name: str) -> Reply:
        return self._ask(f"rpc/{name}", PlainRequest(id=uuid.uuid4().hex).model_dump_json())

    def _ask(self, key: str, text: str) -> Reply:
        raw = self._bus.request(key, text.encode())
        if raw is None:
            raise NoReply("no reply: not running, or not authorised")
        return Reply.model_validate_json(raw)


def _probe(endpoint: str) -> None:
    """Knock at a TCP end point: where nobody listens, Zenoh would try for seconds."""
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if protocol != "tcp" or not port.isdecimal():
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_PROBE_S).close()
    except (OSError, OverflowError) as error:
        raise BusUnreachable(f"nobody listens at {endpoint} ({error})") from error
