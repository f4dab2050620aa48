"""H.264 for the live stream: encoding through PyAV (libx264) and RTP packets by RFC 6184."""

from __future__ import annotations

import base64
import secrets
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction

import av
import cv2
import numpy as np
from av.video.frame import PictureType
from numpy.typing import NDArray

CLOCK_HZ = 90_000
"""RTP clock of H.264."""

_MAX_PAYLOAD = 1400
_PAYLOAD_TYPE = 96
#: Full-range grey to the 16-235 of a television picture, as cameras send it.
_LIMITED_RANGE = np.clip(np.arange(256) * (219 / 255) + 16.5, 16, 235).astype(np.uint8)


class H264Encoder:
    """libx264, ultrafast and without delay: one picture in, its NAL units out."""

    def __init__(self, width: int, height: int, fps: float) -> None:
        if width % 2 or height % 2:
            raise ValueError(f"a {width} x {height} picture: both sides must be even")
        context = av.CodecContext.create("libx264", "w")
        context.width, context.height = width, height
        context.pix_fmt = "yuv420p"
        context.time_base = Fraction(1, CLOCK_HZ)
        context.framerate = Fraction(fps).limit_denominator(1000)
        context.thread_count = 1
        context.options = {
            "preset": "ultrafast",
            "tune": "zerolatency",
            "crf": "20",
            "forced-idr": "1",
            "x264-params": f"keyint={max(2, round(2 * fps))}:scenecut=0:repeat-headers=1",
        }
        self._context = context
        self._shape = (height, width)
        self._last_pts = -1
        self.parameter_sets = self._describe()
        """`fmtp` fields of the session description: profile and the parameter sets."""

    def _describe(self) -> str:
        units = self.encode(np.zeros(self._shape, np.uint8), 0.0, key_frame=True)
        sequence_set = next(unit for unit in units if unit[0] & 0x1F == 7)
        picture_set = next(unit for unit in units if unit[0] & 0x1F == 8)
        sets = ",".join(base64.b64encode(unit).decode() for unit in (sequence_set, picture_set))
        return f"profile-level-id={sequence_set[1:4].hex().upper()};sprop-parameter-sets={sets}"

    def encode(
        self, picture: NDArray[np.uint8], t_s: float, *, key_frame: bool = False
    ) -> list[bytes]:
        """Return the NAL units (without start codes) of a grey or BGR picture."""
        height, width = self._shape
        if picture.ndim == 2:
            planes: NDArray[np.uint8] = np.full((height * 3 // 2, width), 128, np.uint8)
            planes[:height] = cv2.LUT(picture, _LIMITED_RANGE)
        else:
            planes = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420), np.uint8)
        frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
        # The encoder insists on rising stamps; the true one travels in the RTP header.
        self._last_pts = max(self._last_pts + 1, round(t_s * CLOCK_HZ))
        frame.pts = self._last_pts
        frame.time_base = Fraction(1, CLOCK_HZ)
        if key_frame:
            frame.pict_type = PictureType.I
        return [
            unit for packet in self._context.encode(frame) for unit in split_units(bytes(packet))
        ]


def split_units(stream: bytes) -> list[bytes]:
    """Return the NAL units of an Annex B byte stream."""
    units = []
    for piece in stream.split(b"\0\0\1")[1:]:
        # A four-byte start code leaves its first zero at the end of the unit before.
        unit = piece.rstrip(b"\0")
        if unit:
            units.append(unit)
    return units


@dataclass(slots=True)
class RtpPacketizer:
    """Sequence numbers and identity of one player's RTP stream."""

    ssrc: int = field(default_factory=lambda: secrets.randbits(32))
    sequence: int = 0

    def packets(self, units: list[bytes], t_s: float) -> Iterator[bytes]:
        """Yield the RTP packets of one picture's NAL units; the last one carries the marker."""
        stamp = round(t_s * CLOCK_HZ) & 0xFFFFFFFF
        for index, unit in enumerate(units):
            payloads = list(_fragments(unit))
            for part, payload in enumerate(payloads):
                last = index == len(units) - 1 and part == len(payloads) - 1
                header = struct.pack(
                    ">BBHII",
                    0x80,
                    _PAYLOAD_TYPE | (0x80 if last else 0),
                    self.sequence,
                    stamp,
                    self.ssrc,
                )
                self.sequence = (self.sequence + 1) & 0xFFFF
                yield header + payload


def _fragments(unit: bytes) -> Iterator[bytes]:
    """Yield a NAL unit whole, or cut into FU-A fragments."""
    if len(unit) <= _MAX_PAYLOAD:
        yield unit
        return
    indicator, kind = unit[0] & 0xE0 | 28, unit[0] & 0x1F
    body = unit[1:]
    step = _MAX_PAYLOAD - 2
    for start in range(0, len(body), step):
        flags = (0x80 if start == 0 else 0) | (0x40 if start + step >= len(body) else 0)
        yield bytes((indicator, flags | kind)) + body[start : start + step]
