"""A MAVLink camera's shutter: one photo at a time, each one known to exist.

The acknowledgement of a capture only says that it was understood; the photo exists when
CAMERA_IMAGE_CAPTURED comes. That message is sent once and may be lost: it is asked for again.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from config.sensors import Camera
from drivers.autopilot_errors import LinkFailed, Refused
from drivers.autopilot_wire import Received, Wire
from drivers.clock import Clock, sleep_until
from drivers.stamps import MinimumOffset

_log = logging.getLogger(__name__)

_CAPTURE_STATUS, _IMAGE_CAPTURED = 262, 263
_REQUEST_MESSAGE, _START_CAPTURE = 512, 2000
_QUEUE = 2
_CAPTURED_TIMEOUT_S = 2.5
_ASK_AGAIN_TIMEOUT_S = 1.0
_ASK_AGAIN = 3
_STATUS_PERIOD_S = 2.0


@dataclass(frozen=True, slots=True)
class PhotoTaken:
    """A photo that exists."""

    photo_id: int
    """Ours."""
    file_url: str
    """Where its full-resolution file is; may be empty."""
    stamp_s: float
    """Mission time of the exposure, as well as the camera tells it."""
    index: int
    """The camera's own."""


@dataclass(frozen=True, slots=True)
class _Captured:
    index: int
    succeeded: bool
    file_url: str
    boot_s: float
    arrival_s: float


class Shutter:
    """Takes photos one after the other; at most two wait.

    ``on_taken`` and ``on_failed`` (with the photo id and why) are called on the event loop.
    """

    def __init__(
        self,
        wire: Wire,
        settings: Camera,
        clock: Clock,
        on_taken: Callable[[PhotoTaken], None],
        on_failed: Callable[[int, str], None],
    ) -> None:
        self._wire = wire
        self._component = settings.component_id
        self._interval_s = settings.min_interval_s
        self._asked_s = float("-inf")
        self._clock = clock
        self._on_taken, self._on_failed = on_taken, on_failed
        self._loop = asyncio.get_running_loop()
        self._queue: deque[int] = deque()
        self._wake = asyncio.Event()
        self._stamps = MinimumOffset(window_s=30.0, jump_s=60.0)
        self._captured: asyncio.Future[_Captured] | None = None
        self._last_index = self._last_count = -1
        self._newest_boot_s = 0.0
        """The camera's own time of the newest photo that it reported."""
        self._sequence = 0
        self._heard_s = float("-inf")
        self.taken = 0
        """Photos known to exist."""
        wire.listen("HEARTBEAT", self._take_heartbeat, self._component)
        wire.listen("CAMERA_IMAGE_CAPTURED", self._take_captured, self._component)
        wire.listen("CAMERA_CAPTURE_STATUS", self._take_status, self._component)

    @property
    def heard_s(self) -> float:
        """Mission time at which the camera was last heard."""
        return self._heard_s

    def request(self, photo_id: int) -> bool:
        """Ask for a photo; False where two are waiting already."""
        if len(self._queue) >= _QUEUE:
            return False
        self._queue.append(photo_id)
        self._wake.set()
        return True

    async def run(self) -> None:
        """Take what is asked for, until cancelled."""
        status = asyncio.create_task(self._poll_status(), name="camera status")
        try:
            while True:
                await self._wake.wait()
                self._wake.clear()
                while self._queue:
                    await self._take_one(self._queue.popleft())
        finally:
            status.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await status

    async def _take_one(self, photo_id: int) -> None:
        try:
            photo = await self._capture(photo_id)
        except (Refused, LinkFailed) as error:
            self._on_failed(photo_id, str(error))
            return
        self.taken += 1
        self._on_taken(photo)

    async def _capture(self, photo_id: int) -> PhotoTaken:
        # A camera that is asked too soon refuses.
        await sleep_until(self._clock, self._asked_s + self._interval_s)
        self._sequence += 1
        expected = self._last_index + 1
        self._captured = self._loop.create_future()
        self._asked_s = asked_s = self._clock.now_s()
        try:
            await self._wire.command(
                "photo",
                _START_CAPTURE,
                (0.0, 0.0, 1.0, float(self._sequence)),
                self._component,
            )
            captured = await self._existing(self._captured, expected)
        finally:
            self._captured.cancel()
            self._captured = None
        self._last_index = max(self._last_index, captured.index)
        if not captured.succeeded:
            raise Refused("photo: the camera could not store it")
        # The camera's time stamp must lie between the request and the report to be believed.
        stamp_s = self._stamps.map(captured.boot_s, captured.arrival_s)
        if not asked_s <= stamp_s <= captured.arrival_s:
            stamp_s = min(max(stamp_s, asked_s), captured.arrival_s)
        return PhotoTaken(photo_id, captured.file_url, stamp_s, captured.index)

    async def _existing(self, captured: asyncio.Future[_Captured], expected: int) -> _Captured:
        """Wait for the report of the photo, asking for it again where it was lost."""
        timeout_s = _CAPTURED_TIMEOUT_S
        for _ in range(1 + _ASK_AGAIN):
            with contextlib.suppress(TimeoutError):
                return await asyncio.wait_for(asyncio.shield(captured), timeout_s)
            timeout_s = _ASK_AGAIN_TIMEOUT_S
            with contextlib.suppress(Refused):
                await self._wire.command(
                    "image captured",
                    _REQUEST_MESSAGE,
                    (float(_IMAGE_CAPTURED), float(expected)),
                    self._component,
                    tries=1,
                )
        if captured.done():
            return captured.result()
        raise Refused("photo: acknowledged, but the camera reports no picture")

    async def _poll_status(self) -> None:
        """Keep the camera's picture count and clock known."""
        while True:
            with contextlib.suppress(Refused, LinkFailed):
                await self._wire.command(
                    "capture status",
                    _REQUEST_MESSAGE,
                    (float(_CAPTURE_STATUS),),
                    self._component,
                    tries=1,
                )
            await asyncio.sleep(_STATUS_PERIOD_S)

    def _take_heartbeat(self, message: Received) -> None:
        self._heard_s = self._clock.mission_time_of(message.arrival_ns)

    def _take_status(self, message: Received) -> None:
        arrival_s = self._clock.mission_time_of(message.arrival_ns)
        self._heard_s = arrival_s
        boot_s = message.number("time_boot_ms") * 1e-3
        count = message.integer("image_count", -1)

        def note() -> None:
            self._stamps.map(boot_s, arrival_s)
            if count < self._last_count:
                # It was switched off meanwhile, or its card was emptied: it counts anew.
                self._last_index, self._newest_boot_s = count - 1, 0.0
            elif self._captured is None:
                self._last_index = max(self._last_index, count - 1)
            self._last_count = count

        self._hand_over(note)

    def _take_captured(self, message: Received) -> None:
        captured = _Captured(
            message.integer("image_index", -1),
            message.integer("capture_result") == 1,
            message.text("file_url"),
            message.number("time_boot_ms") * 1e-3,
            self._clock.mission_time_of(message.arrival_ns),
        )
        self._hand_over(lambda: self._note_captured(captured))

    def _note_captured(self, captured: _Captured) -> None:
        # One that is known already is an answer to somebody else's request; but some cameras do
        # not count, and a later photo is a new one whatever its number.
        if captured.index <= self._last_index and captured.boot_s <= self._newest_boot_s:
            return
        self._newest_boot_s = max(self._newest_boot_s, captured.boot_s)
        if self._captured is not None and not self._captured.done():
            self._captured.set_result(captured)
        else:
            self._last_index = captured.index

    def _hand_over(self, function: Callable[[], None]) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is gone: nobody waits any more
            self._loop.call_soon_threadsafe(function)
