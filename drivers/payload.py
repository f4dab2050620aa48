"""The payload: gimbal, shutter and exposure of one vehicle, on its own link or the autopilot's.

::

    async with Payload(link, settings, clock, on_photo, on_photo_failed) as payload:
        payload.aim(yaw_rad, pitch_rad)
        payload.want_ev(1 / 3)
        payload.take_photo(photo_id)
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from config.settings import Settings
from drivers.autopilot import AutopilotLink
from drivers.camera_definition import DefinitionFile
from drivers.clock import Clock
from drivers.payload_camera import PhotoTaken, Shutter
from drivers.payload_exposure import ExposureControl
from drivers.payload_gimbal import GimbalLink, GimbalReading

__all__ = ["CameraReading", "GimbalReading", "Payload", "PhotoTaken"]

#: Wall seconds without a heartbeat (1 Hz by the protocol) after which the camera counts as gone.
_CAMERA_SILENT_S = 3.5


@dataclass(frozen=True, slots=True)
class CameraReading:
    """Exposure as applied, and the photos that exist; named as the mission's `CameraState`."""

    stamp_s: float
    ev: float | None
    ev_stamp_s: float
    min_ev: float
    max_ev: float
    step_ev: float
    evs: tuple[float, ...]
    manual: bool
    shutter_s: float | None
    photos_taken: int
    last_photo_id: int
    failed_photo_id: int
    online: bool


class Payload:
    """Gimbal and camera; an async context manager inside an open `AutopilotLink`.

    ``on_photo`` and ``on_photo_failed`` (photo id, reason) are called on the event loop.
    """

    def __init__(
        self,
        link: AutopilotLink,
        settings: Settings,
        clock: Clock,
        on_photo: Callable[[PhotoTaken], None],
        on_photo_failed: Callable[[int, str], None],
    ) -> None:
        self._clock = clock
        self._on_photo, self._on_photo_failed = on_photo, on_photo_failed
        self._last_photo_id = self._failed_photo_id = -1
        self._gimbal = GimbalLink(
            link.wire,
            settings.gimbal,
            clock,
            lambda: reading.yaw_rad if (reading := link.vehicle()) is not None else None,
        )
        self._shutter = Shutter(link.wire, settings.camera, clock, self._taken, self._failed)
        self._exposure = ExposureControl(
            link.wire,
            settings.camera.component_id,
            clock,
            lambda: self.online,
            settings.exposure.step_ev,
            settings.camera.shutter_s,
            DefinitionFile(link.wire, settings.camera.component_id).read,
        )
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        """Begin to look for gimbal and camera; does not wait until they are found."""
        self._tasks = [
            asyncio.create_task(self._gimbal.run(), name="gimbal"),
            asyncio.create_task(self._shutter.run(), name="shutter"),
            asyncio.create_task(self._exposure.run(), name="exposure"),
        ]
        return self

    async def __aexit__(self, *_: object) -> None:
        """Command nothing more."""
        for task in self._tasks:
            task.cancel()
        for task in self._tasks:
            with contextlib.suppress(asyncio.CancelledError):
                await task

    @property
    def online(self) -> bool:
        """The camera's heartbeats arrive."""
        silent_s = self._clock.now_s() - self._shutter.heard_s
        return silent_s <= _CAMERA_SILENT_S * max(1.0, self._clock.factor())

    @property
    def exposure_known(self) -> bool:
        """The camera was asked what exposure control it has; then an EV of None means none."""
        return self._exposure.known

    @property
    def manual_exposure(self) -> bool:
        """EV is absolute; otherwise it biases the camera's own automatic."""
        return self._exposure.manual

    def rest(self, resting: bool) -> None:
        """Let the gimbal tell seldom where it looks, while nothing flies; at first often."""
        self._gimbal.rest(resting)

    def gimbal(self) -> GimbalReading | None:
        """Return where the gimbal really looks."""
        return self._gimbal.reading()

    def camera(self) -> CameraReading | None:
        """Return the camera's state; None before it was first heard."""
        if self._shutter.heard_s == float("-inf"):
            return None
        exposure = self._exposure
        return CameraReading(
            stamp_s=self._shutter.heard_s,
            ev=exposure.ev,
            ev_stamp_s=exposure.ev_stamp_s,
            min_ev=exposure.min_ev,
            max_ev=exposure.max_ev,
            step_ev=exposure.step_ev,
            evs=exposure.evs,
            manual=exposure.manual,
            shutter_s=exposure.shutter_s,
            photos_taken=self._shutter.taken,
            last_photo_id=self._last_photo_id,
            failed_photo_id=self._failed_photo_id,
            online=self.online,
        )

    def aim(self, yaw_rad: float, pitch_rad: float) -> bool:
        """Point the optical axis to ENU yaw and pitch now; False without a gimbal."""
        return self._gimbal.aim(yaw_rad, pitch_rad)

    def want_ev(self, ev: float) -> None:
        """Ask for an exposure value; the newest wish counts."""
        self._exposure.want(ev)

    def take_photo(self, photo_id: int) -> bool:
        """Ask for a photo; False (and failed) where two are waiting already."""
        if self._shutter.request(photo_id):
            return True
        self._failed(photo_id, "the camera is still busy with earlier photos")
        return False

    def _taken(self, photo: PhotoTaken) -> None:
        self._last_photo_id = photo.photo_id
        self._on_photo(photo)

    def _failed(self, photo_id: int, reason: str) -> None:
        self._failed_photo_id = photo_id
        self._on_photo_failed(photo_id, reason)
