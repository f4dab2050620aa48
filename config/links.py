"""Where the autopilot, the payload and the Zenoh bus are reached."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from config.model import ConfigModel, Positive


class Autopilot(ConfigModel):
    """MAVLink links, as MAVSDK 4 writes them (`udpin://`, `tcpout://`, `serial:///dev/...:baud`)."""

    url: str = "udpin://127.0.0.1:14540"
    payload_url: str = ""
    """Camera and gimbal when they are on a link of their own; empty: same link."""
    system_id: Annotated[int, Field(ge=1, le=255)] = 1
    """The vehicle we are bound to; every other one is ignored."""
    connect_timeout_s: Positive = 15.0
    position_rate_hz: Annotated[float, Field(ge=5, le=200)] = 50.0
    set_parameters: bool = False
    """Set the parameters that preflight demands (offboard loss, return height), not only check."""


class Bus(ConfigModel):
    """The Zenoh bus. Loopback only unless told otherwise."""

    listen: str = "tcp/127.0.0.1:7447"
    """End point on which `serve` opens the router."""
    connect: str = ""
    """End point that clients connect to; empty: the same as `listen`."""

    @property
    def endpoint(self) -> str:
        """The end point that a client connects to."""
        return self.connect or self.listen
