"""Live video over RTSP: every packet decoded, the newest picture delivered, nothing queued."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import math
import threading
import time
from collections import deque
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
#: Pictures that waited while the stream was examined come at once; they are not live.
_PROBED_NS = 20_000_000
_LONGEST_INTERVAL_S = 1.0
#: At rest what comes is left to gather for so long: to wake for each piece costs most of it.
_REST_NAP_S = 0.25
#: A packet that took longer was waited for: nothing more lies ready.
_WAITED_NS = 2_000_000
#: A stream that marks no key pictures is decoded from anywhere after so long.
_KEY_PATIENCE_S = 5.0
_OFFSET_WINDOW_S = 20.0
#: 16-235 of a television picture back to the full range.
_FULL_RANGE = np.clip((np.arange(256) - 16.0) * (255 / 219) + 0.5, 0, 255).astype(np.uint8)
_JPEG_RANGE = 2


@dataclass(frozen=True, slots=True)
class _Decoded:
    """A picture as the decoder left it; grey levels are taken only when it is delivered."""

    picture: av.VideoFrame
    arrival_ns: int
    sent_s: float | None
    """The sender's own time stamp."""
    interval_s: float
    """Least time between two pictures of late."""


class _Intervals:
    """The least time between two pictures among the last thirty."""

    def __init__(self) -> None:
        self._values: deque[float] = deque(maxlen=30)
        self._last_s: float | None = None

    def least(self, time_s: float) -> float:
        """Take the time of one more picture; return the least interval, 0 before the second."""
        if self._last_s is not None and 0 < time_s - self._last_s < _LONGEST_INTERVAL_S:
            self._values.append(time_s - self._last_s)
        self._last_s = time_s
        return min(self._values, default=0.0)


class VideoStream:
    """One RTSP stream, read by a thread of its own.

    ``latency_s`` is capture to decoded in wall seconds, beyond the one picture interval that the
    parser holds every picture back until the next one begins. Measured: 0.057 s at 1080p30 in
    all, hence 0.024; 0.004 at 640 x 480. ``timeout_s`` of wall time without a packet ends the
    connection; it is opened anew with a back-off of 0.25 s doubling to 4 s. Delivered are at most
    ``rate_hz`` pictures a second of the sender's time, at most ``width_px`` wide.
    """

    def __init__(
        self,
        url: str,
        clock: Clock,
        timeout_s: float = 2.0,
        latency_s: float = 0.02,
        *,
        rate_hz: float = math.inf,
        width_px: int = 1 << 16,
    ) -> None:
        self._url = url
        self._clock = clock
        self._timeout_s = timeout_s
        self._latency_s = latency_s
        # Pictures come a little early or late; the next one would be half a period too late.
        self._period_s = 0.75 / rate_hz
        self._width_px = width_px
        # Nothing is lost on its way, where the camera can.
        self._transport = "tcp"
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._newest: _Decoded | None = None
        self._offset = MinimumOffset(_OFFSET_WINDOW_S)
        self._sequence = 0
        self.connects = 0
        """Connections opened so far."""
        self.decoded = 0
        """Pictures decoded so far, used or not."""
        self.last_error = ""
        """Why the last connection ended, or could not be opened."""
        self.resting = False
        """Set from any thread: key pictures are enough, the others are not decoded."""
        self.heard_ns = 0
        """Monotonic time at which something last came, decoded or not; 0: never."""

    def rest(self, resting: bool) -> None:
        """Set whether key pictures are enough; at first all are decoded."""
        self.resting = resting

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
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(ended.wait(), self._timeout_s + 1.0)

    def _deliver(self, on_frame: Callable[[Frame], None]) -> None:
        with self._lock:
            decoded, self._newest = self._newest, None
        if decoded is None or self._stop.is_set():
            return
        self._sequence += 1
        grey = at_most(self._width_px, grey_of(decoded.picture))
        stamp_s = self._stamp_s(decoded)
        age_s = self._clock.mission_time_of(decoded.arrival_ns) - stamp_s
        on_frame(Frame(stamp_s, self._sequence, grey, age_s))

    def _stamp_s(self, decoded: _Decoded) -> float:
        """Return the mission time of capture: the sender's clock where it has one.

        The sender's stamps, carried over by the least transport delay seen, show a picture that
        waited on its way; the arrival alone would call it fresh.
        """
        arrival_s = self._clock.mission_time_of(decoded.arrival_ns)
        if decoded.sent_s is not None:
            arrival_s = self._offset.map(decoded.sent_s, arrival_s)
        return arrival_s - decoded.interval_s - self._latency_s * self._clock.factor()

    def _read(self, wake: Callable[[], None]) -> None:
        back_off_s = _FIRST_BACK_OFF_S
        while not self._stop.is_set():
            decoded_before = self.decoded
            try:
                self._read_once(wake)
                reason = "the stream ended"
            except (av.error.FFmpegError, OSError, ValueError) as error:
                reason = str(error) or type(error).__name__
                if getattr(error, "errno", None) == errno.EPROTONOSUPPORT:
                    # It does not send that way: some cameras know only one of the two.
                    self._transport = "udp" if self._transport == "tcp" else "tcp"
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
                "rtsp_transport": self._transport,
                "flags": "low_delay",
                # Two pictures are enough to begin with. `nobuffer` would throw them away and
                # with them the first key frame: seconds of nothing with a long key interval.
                "analyzeduration": "1",
                "probesize": "32",
                "fpsprobesize": "0",
            },
            # A read that times out yields the picture held back by the parser; the next one ends.
            timeout=(self._timeout_s, self._timeout_s / 2),
        ) as container:
            if not container.streams.video:
                raise ValueError("no video in the stream")
            stream = container.streams.video[0]
            stream.thread_type = "SLICE"
            stream.codec_context.thread_count = 1
            self.connects += 1
            self._offset = MinimumOffset(_OFFSET_WINDOW_S)
            opened_ns = time.monotonic_ns()
            intervals = _Intervals()
            kept_s = -math.inf
            for picture in self._pictures(container, stream):
                self.decoded += 1
                arrival_ns = time.monotonic_ns()
                sent_s = picture.time
                time_s = self._clock.mission_time_of(arrival_ns) if sent_s is None else sent_s
                decoded = _Decoded(picture, arrival_ns, sent_s, intervals.least(time_s))
                if arrival_ns < opened_ns + _PROBED_NS or 0 <= time_s - kept_s < self._period_s:
                    continue
                kept_s = time_s
                with self._lock:
                    pending = self._newest is not None
                    self._newest = decoded
                if not pending:
                    wake()

    def _pictures(
        self, container: av.container.InputContainer, stream: av.VideoStream
    ) -> Iterator[av.VideoFrame]:
        keys_only_ns: int | None = None
        for packet in self._packets(container, stream):
            self.heard_ns = time.monotonic_ns()
            if self.resting:
                keys_only_ns = self.heard_ns
            # What was left out is missed by all pictures up to the next key picture.
            missed = (
                keys_only_ns is not None and self.heard_ns - keys_only_ns < _KEY_PATIENCE_S * 1e9
            )
            if missed and not packet.is_keyframe:
                continue
            if not self.resting:
                keys_only_ns = None
            try:
                yield from packet.decode()
            except av.error.InvalidDataError:
                # One damaged packet; the next key frame mends the picture.
                continue

    def _packets(
        self, container: av.container.InputContainer, stream: av.VideoStream
    ) -> Iterator[av.Packet[av.VideoStream]]:
        """Yield what comes until it ends or we stop; at rest by many at a time."""
        packets = container.demux(stream)
        while True:
            asked_ns = time.monotonic_ns()
            packet = next(packets, None)
            if packet is None or self._stop.is_set():
                return
            waited = time.monotonic_ns() - asked_ns > _WAITED_NS
            yield packet
            if self.resting and waited:
                self._stop.wait(_REST_NAP_S)


def grey_of(picture: av.VideoFrame) -> Bytes:
    """Return the (H, W) full-range grey levels of a decoded picture."""
    if not picture.format.name.startswith(("yuv4", "yuvj4", "nv12")):
        return np.asarray(picture.to_ndarray(format="gray"), np.uint8)
    plane = picture.planes[0]
    rows = np.frombuffer(memoryview(plane), np.uint8).reshape(plane.height, plane.line_size)
    luma = rows[:, : plane.width]
    if picture.format.name.startswith("yuvj") or picture.color_range == _JPEG_RANGE:
        return np.array(luma)
    return np.asarray(cv2.LUT(luma, _FULL_RANGE), np.uint8)


def at_most(width_px: int, grey: Bytes) -> Bytes:
    """Return a picture (H, W) scaled down, mean grey kept, to at most so many pixels of width."""
    height, width = grey.shape
    if width <= width_px:
        return grey
    size = width_px, max(1, round(height * width_px / width))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)
