"""Live video over RTSP: every packet decoded, the newest picture delivered, nothing queued."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import av
import cv2
import numpy as np

from drivers.clock import Clock
from drivers.stamps import MinimumOffset
from perception.values import Bytes, Frame

_log = logging.getLogger(__name__)

_FIRST_BACK_OFF_S = 0.25
_LAST_BACK_OFF_S = 4.0
#: 16-235 of a television picture back to the full range.
_FULL_RANGE = np.clip((np.arange(256) - 16.0) * (255 / 219) + 0.5, 0, 255).astype(np.uint8)
_JPEG_RANGE = 2


@dataclass(frozen=True, slots=True)
class _Decoded:
    """A picture as the decoder left it; grey levels are taken only when it is delivered."""

    picture: av.VideoFrame
    arrival_ns: int
    pts_s: float | None


class VideoStream:
    """One RTSP stream, read by a thread of its own.

    ``latency_s`` is capture to decoded in wall seconds (measured: 0.06 for 1080p at 30 Hz over
    loopback). ``timeout_s`` of wall time without a packet ends the connection; it is opened anew
    with a back-off of 0.25 s doubling to 4 s.
    """

    def __init__(
        self, url: str, clock: Clock, timeout_s: float = 2.0, latency_s: float = 0.06
    ) -> None:
        self._url = url
        self._clock = clock
        self._timeout_s = timeout_s
        self._latency_s = latency_s
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._newest: _Decoded | None = None
        self._offset = MinimumOffset(window_s=20.0)
        self._sequence = 0
        self.connects = 0
        """Connections opened so far."""
        self.decoded = 0
        """Pictures decoded so far, used or not."""
        self.last_error = ""
        """Why the last connection ended, or could not be opened."""

    async def run(self, on_frame: Callable[[Frame], None]) -> None:
        """Deliver frames on the event loop until cancelled."""
        loop = asyncio.get_running_loop()

        def wake() -> None:
            loop.call_soon_threadsafe(self._deliver, on_frame)

        ended = asyncio.Event()

        def work() -> None:
            try:
                self._read(wake)
            finally:
                loop.call_soon_threadsafe(ended.set)

        self._stop.clear()
        thread = threading.Thread(target=work, name="video", daemon=True)
        thread.start()
        try:
            await ended.wait()
        finally:
            self._stop.set()
            # A silent stream is left within its time-out; a living one with the next packet.
            await asyncio.shield(asyncio.wait_for(ended.wait(), self._timeout_s + 1.0))

    def _deliver(self, on_frame: Callable[[Frame], None]) -> None:
        with self._lock:
            decoded, self._newest = self._newest, None
        if decoded is None or self._stop.is_set():
            return
        self._sequence += 1
        on_frame(Frame(self._stamp_s(decoded), self._sequence, grey_of(decoded.picture)))

    def _stamp_s(self, decoded: _Decoded) -> float:
        """Return the mission time of capture: the sender's clock where it has one.

        The sender's stamps, carried over by the least transport delay seen, show a picture that
        waited on its way; the arrival alone would call it fresh.
        """
        arrival_s = self._clock.mission_time_of(decoded.arrival_ns)
        if decoded.pts_s is not None:
            arrival_s = self._offset.map(decoded.pts_s, arrival_s)
        return arrival_s - self._latency_s * self._clock.factor()

    def _read(self, wake: Callable[[], None]) -> None:
        back_off_s = _FIRST_BACK_OFF_S
        while not self._stop.is_set():
            decoded_before = self.decoded
            try:
                self._read_once(wake)
                reason = "the stream ended"
            except (av.error.FFmpegError, OSError, ValueError) as error:
                reason = str(error) or type(error).__name__
            if self._stop.is_set():
                return
            if self.decoded > decoded_before:
                back_off_s = _FIRST_BACK_OFF_S
            if reason != self.last_error or self.decoded > decoded_before:
                _log.warning("video %s: %s; trying again", self._url, reason)
            self.last_error = reason
            self._stop.wait(back_off_s)
            back_off_s = min(2 * back_off_s, _LAST_BACK_OFF_S)

    def _read_once(self, wake: Callable[[], None]) -> None:
        with av.open(
            self._url,
            options={
                "rtsp_transport": "tcp",
                "fflags": "nobuffer",
                "flags": "low_delay",
                "analyzeduration": "0",
                "probesize": "32768",
            },
            timeout=(self._timeout_s, self._timeout_s),
        ) as container:
            if not container.streams.video:
                raise ValueError("no video in the stream")
            stream = container.streams.video[0]
            stream.thread_type = "SLICE"
            stream.codec_context.thread_count = 1
            self.connects += 1
            self._offset.clear()
            for picture in self._pictures(container, stream):
                self.decoded += 1
                pts_s = None if picture.pts is None else float(picture.pts * picture.time_base)
                with self._lock:
                    pending = self._newest is not None
                    self._newest = _Decoded(picture, time.monotonic_ns(), pts_s)
                if not pending:
                    wake()

    def _pictures(
        self, container: av.container.InputContainer, stream: av.VideoStream
    ) -> Iterator[av.VideoFrame]:
        for packet in container.demux(stream):
            if self._stop.is_set():
                return
            try:
                yield from packet.decode()
            except av.error.InvalidDataError:
                # One damaged packet; the next key frame mends the picture.
                continue


def grey_of(picture: av.VideoFrame) -> Bytes:
    """Return the (H, W) full-range grey levels of a decoded picture."""
    if not picture.format.name.startswith(("yuv4", "yuvj4", "nv12")):
        return np.asarray(picture.to_ndarray(format="gray"), np.uint8)
    plane = picture.planes[0]
    rows = np.frombuffer(plane, np.uint8).reshape(plane.height, plane.line_size)
    luma = rows[:, : plane.width]
    if picture.format.name.startswith("yuvj") or picture.color_range == _JPEG_RANGE:
        return luma.copy()
    return np.asarray(cv2.LUT(luma, _FULL_RANGE), np.uint8)
