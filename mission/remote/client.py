"""Talk to a daemon from anywhere: start a mission, watch it, end it.

::

    with Client("drone-1") as drone:
        drone.start("hill-3", operator="A. Person", rotor_locked=True)

Over loopback nothing else is needed. From elsewhere: ``Client("heron",
router="tls/192.168.1.5:7448", keys="keys/ada")``, with the folder of one's own certificate.
"""

from __future__ import annotations

import socket
import time
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Self

from config.inspection import BladeName, Side
from config.links import Bus as BusSettings
from drivers.bus import Bus, BusUnreachable, Key, Sample
from drivers.bus_access import CERTIFICATE_FILE, LOCAL, request_key
from drivers.certificates import common_name
from mission.flight.observation import RequestKind, Vec3
from mission.remote.messages import (
    EventMessage,
    PlainRequest,
    RecordedMessage,
    Reply,
    ResumeRequest,
    StartRequest,
    StateMessage,
    TurbineInfo,
)
from mission.remote.understood import Heard, understood

NO_REPLY = "no reply: not running, or not authorised"
_PROBE_S = 3.0


class NoReply(ConnectionError):
    """Nobody answered: the daemon is not running, or we are not authorised."""


def bus_settings(router: str = "", keys: str | Path = "") -> BusSettings:
    """Return the settings of a client; empty: loopback, without a certificate."""
    return BusSettings(connect=router, keys=str(keys))


class Client:
    """A blocking client of one vehicle's daemon."""

    def __init__(
        self,
        vehicle: str = "drone-1",
        bus: BusSettings | None = None,
        *,
        router: str = "",
        keys: str | Path = "",
    ) -> None:
        """Connect.

        ``router``: where, as tcp/127.0.0.1:7447 or tls/192.168.1.5:7448; ``keys``: the folder of
        one's own certificate, for TLS. ``bus`` stands for both. Raises
        `drivers.bus.BusUnreachable` when nobody listens there, or lets us in, and
        `drivers.bus_session.BusNotSafe` when the keys are missing.
        """
        settings = bus or bus_settings(router, keys)
        probe(settings.endpoint)
        self._who = own_name(settings)
        self.vehicle = vehicle
        self._bus = Bus.open_client(settings, vehicle)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
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
        blades: tuple[BladeName, ...] | None = None,
        sides: tuple[Side, ...] | None = None,
        blade_serials: Mapping[BladeName, str] | None = None,
        nacelle_yaw_deg: float | None = None,
        blade_pitch_deg: float | None = None,
        launch_enu_m: Vec3 | None = None,
        valid_s: float | None = None,
        airborne: bool = False,
        rendezvous_w: Vec3 | None = None,
        dry_run: bool = False,
    ) -> Reply:
        """Start a mission; `rotor_locked` is the operator's word. Raises `NoReply`.

        ``request_id``: the same id never starts a second mission, however often it is sent.
        ``blades``, ``sides``: what to fly; None: what is configured. ``blade_serials``,
        ``nacelle_yaw_deg`` (compass, where the rotor faces), ``blade_pitch_deg`` and
        ``launch_enu_m`` (take-off from the tower's base) where known. ``valid_s``: a request that
        arrives later than this starts nothing. ``airborne``: take over a hovering vehicle, and
        hand it back hovering at ``rendezvous_w`` (east, north, up of its home; where it was taken
        over). ``dry_run``: only check.
        """
        request = StartRequest(
            id=request_id or uuid.uuid4().hex,
            site=site,
            operator=operator,
            rotor_locked=rotor_locked,
            blades=blades,
            sides=sides,
            blade_serials=dict(blade_serials or {}),
            nacelle_yaw_deg=nacelle_yaw_deg,
            blade_pitch_deg=blade_pitch_deg,
            launch_enu_m=launch_enu_m,
            airborne=airborne,
            rendezvous_w=rendezvous_w,
            expires_utc_s=None if valid_s is None else time.time() + valid_s,
            dry_run=dry_run,
        )
        return self.send_start(request)

    def send_start(self, request: StartRequest) -> Reply:
        """Send a request to start a mission, as it is. Raises `NoReply`."""
        return self._ask(RequestKind.START, request.model_dump_json())

    def status(self) -> Reply:
        """Return how the mission stands. Raises `NoReply`."""
        return self._plain("status")

    def turbines(self) -> tuple[TurbineInfo, ...]:
        """Return the turbines that a mission may be started for. Raises `NoReply`."""
        return self.turbines_reply().turbines

    def turbines_reply(self) -> Reply:
        """Return the whole reply with the turbines. Raises `NoReply`."""
        return self._plain("turbines")

    def history(self) -> Reply:
        """Return what has happened so far: state, events, photos, rotor. Raises `NoReply`."""
        return self._plain("history")

    def vehicles(self) -> tuple[str, ...]:
        """Return the names of all vehicles at this router whose daemons are up."""
        return self._bus.alive()

    def pause(self) -> Reply:
        """Hold where the vehicle is; `resume` goes on. Raises `NoReply`."""
        return self._plain(RequestKind.PAUSE)

    def resume(
        self,
        mission: str = "",
        *,
        operator: str = "",
        rotor_locked: bool = False,
        request_id: str | None = None,
        airborne: bool = False,
        dry_run: bool = False,
    ) -> Reply:
        """Go on after a pause; where no mission runs, with one that ended unfinished.

        ``mission``: name of its folder; empty: the newest. That takes the operator's word anew
        that the rotor is still locked. ``airborne``: the vehicle hovers, and is taken over there.
        Raises `NoReply`.
        """
        request = ResumeRequest(
            id=request_id or uuid.uuid4().hex,
            mission=mission,
            operator=operator,
            rotor_locked=rotor_locked,
            airborne=airborne,
            dry_run=dry_run,
        )
        return self._ask(RequestKind.RESUME, request.model_dump_json())

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
        """Call back with every state and event from now on (on the bus's thread).

        What was before is told by `history`; the newest state is there within 0.2 s, of
        a vehicle at rest within 0.5 s.
        """
        self._hear(Key.STATE, StateMessage, on_state)
        if on_event is not None:
            self._hear(Key.EVENT, EventMessage, on_event)
        if on_recorded is not None:
            self._hear(Key.RECORDED, RecordedMessage, on_recorded)

    def _hear(self, key: Key, kind: type[Heard], tell: Callable[[Heard], None]) -> None:
        def take(sample: Sample) -> None:
            message = understood(sample, kind)
            if message is not None:
                tell(message)

        self._bus.subscribe(key, take)

    def _plain(self, name: str) -> Reply:
        return self._ask(name, PlainRequest(id=uuid.uuid4().hex).model_dump_json())

    def _ask(self, verb: str, text: str) -> Reply:
        raw = self._bus.request(request_key(verb, self._who), text.encode())
        if raw is None:
            raise NoReply(NO_REPLY)
        return Reply.model_validate_json(raw)


def own_name(settings: BusSettings) -> str:
    """Return in whose name we ask: the certificate's, or `LOCAL` without TLS."""
    if not settings.endpoint.startswith("tls/"):
        return LOCAL
    file = Path(settings.keys) / CERTIFICATE_FILE
    return common_name(file) if settings.keys and file.is_file() else LOCAL


def probe(endpoint: str) -> None:
    """Knock at an end point: where nobody listens, Zenoh would try for seconds.

    Raises `drivers.bus.BusUnreachable`.
    """
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if protocol not in ("tcp", "tls") or not port.isdecimal():
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_PROBE_S).close()
    except (OSError, OverflowError) as error:
        raise BusUnreachable(f"nobody listens at {endpoint} ({error})") from error
