"""What the driver counts: shown in metrics and in the pre-flight checks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum


class Dropped(StrEnum):
    """Why a datagram was not used."""

    SOURCE = "wrong source address"
    MALFORMED = "not a packet"
    REPEATED = "seen before"
    PAST = "older than the scan before"
    FUTURE = "stamped in the future"
    FRAGMENT = "too little of a scan"


class Link(StrEnum):
    """How far the driver has come with the sensor."""

    CLOSED = "closed"
    SEARCHING = "searching"
    CONFIGURING = "configuring"
    WAITING = "waiting for the sensor to sample"
    STREAMING = "streaming"


@dataclass(frozen=True, slots=True)
class Statistics:
    """A snapshot; counts are since the driver was made."""

    link: Link = Link.CLOSED
    serial: str = ""
    work_state: int = 0
    """Key 0x8006 as last reported (`WorkState`), 0 when unknown."""
    temperature_c: float | None = None
    scans: int = 0
    packets: int = 0
    """Point packets used."""
    points: int = 0
    """Returns delivered."""
    imu: int = 0
    lost: int = 0
    """Packets missing by the running number."""
    dropped: Mapping[Dropped, int] = field(default_factory=dict)
    configured: int = 0
    """Times the sensor was configured; more than one: it fell silent in between."""
    receive_buffer_bytes: int = 0
    warning: str = ""
    """What a person should mend; empty when all is well."""
