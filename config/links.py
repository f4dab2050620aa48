"""Where the autopilot, the payload and the Zenoh bus are reached."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from config.model import ConfigModel, Positive
from config.patterns import END_POINT, TLS_END_POINT


class Autopilot(ConfigModel):
    """MAVLink links, as MAVSDK 4 writes them (`udpin://`, `tcpout://`, `serial:///dev/...:baud`)."""

    url: str = "udpin://127.0.0.1:14540"
    """The autopilot's link."""
    payload_url: str = ""
    """Camera and gimbal when they are on a link of their own; empty: same link."""
    system_id: Annotated[int, Field(ge=1, le=255)] = 1
    """The vehicle we are bound to; every other one is ignored."""
    connect_timeout_s: Positive = 15.0
    """After so long without the vehicle that is told, and it is tried again."""
    position_rate_hz: Annotated[float, Field(ge=5, le=200)] = 50.0
    """Of position and attitude, asked of the autopilot."""
    record_link: bool = True
    """Record every MAVLink message as it was on the wire (`link.tlog`)."""
    strict: bool = True
    """Refuse a vehicle that does not tell of its remote control, battery or failsafes; a
    simulator need not have them."""
    set_parameters: bool = False
    """Set the parameters that preflight demands (offboard loss, return height), not only check."""


class Bus(ConfigModel):
    """The Zenoh bus: loopback for this computer's own processes, TLS for everyone else."""

    listen: Annotated[str, Field(pattern=END_POINT)] = "tcp/127.0.0.1:7447"
    """End point on which `serve` opens the router to this computer's processes; without TLS."""
    insecure: bool = False
    """Let `listen` be reached from elsewhere: whoever reaches it may then start missions."""
    remote: Annotated[str, Field(pattern=TLS_END_POINT)] = ""
    """TLS end point for clients with a certificate, as tls/0.0.0.0:7448; empty: none."""
    uplink: Annotated[str, Field(pattern=TLS_END_POINT)] = ""
    """TLS end point of a site's router to join, as tls/192.168.1.2:7448; empty: none."""
    keys: str = ""
    """Folder with ca.pem, cert.pem, key.pem and roles.toml, as `bladescout keys` makes it."""
    verify_name: bool = True
    """The other side's certificate must name the host that was connected to."""
    requests_per_s: Annotated[float, Field(gt=0, le=1000)] = 20.0
    """Requests that one client may make, after a burst of as many."""
    connect: Annotated[str, Field(pattern=END_POINT)] = ""
    """End point that clients connect to; empty: the same as `listen`."""

    @property
    def endpoint(self) -> str:
        """The end point that a client connects to."""
        return self.connect or self.listen

    @property
    def exposed(self) -> bool:
        """Whether `listen` can be reached from other computers, without any certificate."""
        protocol, _, address = self.listen.partition("/")
        host = address.rpartition(":")[0].strip("[]")
        here = host in ("localhost", "::1") or host.startswith("127.")
        return not here and not protocol.startswith("unix")
