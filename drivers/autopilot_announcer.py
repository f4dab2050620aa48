"""What this computer tells the vehicle's other listeners: its health, its phase, its photos.

A ground station on the same MAVLink network (QGroundControl) shows all three. The link library
sends a heartbeat of its own, of type generic; ours is the one of type onboard controller.
"""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass
from enum import IntEnum

from drivers.autopilot_errors import LinkFailed
from drivers.autopilot_wire import Wire

log = logging.getLogger(__name__)

_ONBOARD_CONTROLLER, _NO_AUTOPILOT, _MAVLINK_2 = 18, 8, 3
_CHUNK = 50
#: More chunks than this say nothing more to somebody who reads them on a small screen.
_MAX_TEXT = 3 * _CHUNK


class Health(IntEnum):
    """MAV_STATE of the companion."""

    BOOT = 1
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5
    """Something that is needed for flying does not work."""


class Level(IntEnum):
    """MAV_SEVERITY of a text."""

    CRITICAL = 2
    WARNING = 4
    NOTICE = 5
    INFO = 6


@dataclass(frozen=True, slots=True)
class PhotoPlace:
    """Where and when a photo was taken."""

    index: int
    boot_ms: int
    utc_us: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    height_m: float
    """Above take-off."""
    quaternion: tuple[float, float, float, float]
    """Of the camera, w x y z, NED."""
    url: str


class Announcer:
    """Sends on the vehicle's link; a failing link is the control tick's concern, not ours."""

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self._text_id = 0

    def heartbeat(self, health: Health) -> None:
        """Send one heartbeat; the caller keeps the rate of one a second."""
        self._send(
            "HEARTBEAT",
            {
                "type": _ONBOARD_CONTROLLER,
                "autopilot": _NO_AUTOPILOT,
                "base_mode": 0,
                "custom_mode": 0,
                "system_status": int(health),
                "mavlink_version": _MAVLINK_2,
            },
        )

    def say(self, level: Level, text: str) -> None:
        """Send a sentence, in chunks where it is long."""
        raw = text.encode("ascii", errors="replace").decode()[:_MAX_TEXT]
        chunks = [raw[start : start + _CHUNK] for start in range(0, len(raw), _CHUNK)]
        if len(chunks) > 1:
            self._text_id = self._text_id % 0xFFFF + 1
        for number, chunk in enumerate(chunks):
            self._send(
                "STATUSTEXT",
                {
                    "severity": int(level),
                    "text": chunk,
                    "id": self._text_id if len(chunks) > 1 else 0,
                    "chunk_seq": number,
                },
            )

    def photo(self, place: PhotoPlace) -> None:
        """Send CAMERA_IMAGE_CAPTURED for a photo that exists."""
        self._send(
            "CAMERA_IMAGE_CAPTURED",
            {
                "time_boot_ms": place.boot_ms & 0xFFFFFFFF,
                "time_utc": place.utc_us,
                "camera_id": 0,
                "lat": round(place.latitude_deg * 1e7),
                "lon": round(place.longitude_deg * 1e7),
                "alt": round(place.altitude_m * 1e3),
                "relative_alt": round(place.height_m * 1e3),
                "q": list(place.quaternion),
                "image_index": place.index,
                "capture_result": 1,
                "file_url": place.url[:204],
            },
        )

    def _send(self, name: str, fields: dict[str, object]) -> None:
        try:
            self._wire.send(name, json.dumps(fields), component_id=0)
        except LinkFailed as error:
            log.debug("%s", error)
