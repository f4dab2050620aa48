"""LVX2, the file format of Livox Viewer 2 (vendor's specification v1.0, 2023): read and write.

Little-endian. A public header (24 bytes), a private header (5), a block of 63 bytes for each
sensor, then frames of 50 ms: a header of three int64 (own offset, next offset, index) and packages,
each with a header of 27 bytes and its points as on the wire. Written from the vendor's document; no
file of a real unit could be obtained.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from drivers.bad_file import BadFile, read_bytes
from drivers.livox.packets import POINT_BYTES
from drivers.livox.recording import POINT_INTERVAL_NS, RecordedPacket
from perception.geometry import rotation_from_euler
from perception.values import Float

_PUBLIC = struct.Struct("<16s4BI")
_PRIVATE = struct.Struct("<IB")
_DEVICE = struct.Struct("<16s16sIBBB6f")
_FRAME = struct.Struct("<3q")
_PACKAGE = struct.Struct("<BIBBQHBIB4x")
_SIGNATURE = b"livox_tech"
_MAGIC = 0xAC0EA767
_FRAME_MS = 50
_MID360 = 9
_AGAIN = "copy the file again, or record it with Livox Viewer 2"


@dataclass(frozen=True, slots=True, eq=False)
class Lvx2:
    """One sensor's packets of a file."""

    serial: str
    packets: tuple[RecordedPacket, ...]
    mounting: tuple[Float, Float] | None
    """Rotation (3, 3) and offset (3,) of the sensor in its carrier, where the file sets them."""
    sensors: int
    """In the whole file; the one with the most packets is returned."""
    cut_off: bool
    """Whether the file ends within a package: what stands before it is returned."""


def read_lvx2(path: Path) -> Lvx2:
    """Return what an LVX2 file holds; raise `BadFile`."""
    content = read_bytes(path)
    devices, at = _devices(path, content)
    packets: list[tuple[int, RecordedPacket]] = []
    cut_off = False
    while at < len(content):
        if at + _FRAME.size > len(content):
            cut_off = True
            break
        own, following, _ = _FRAME.unpack_from(content, at)
        following = following or len(content)  # some writers leave the last one open
        if own != at or following <= at:
            raise BadFile(path, f"no frame begins at byte {at} where one must", _AGAIN)
        cut_off = following > len(content)
        end = min(following, len(content))
        if not _packages(content, at + _FRAME.size, end, packets) and not cut_off:
            raise BadFile(path, f"the frame at byte {at} is damaged", _AGAIN)
        at = end
    if not packets:
        raise BadFile(path, "holds no points", "record while the sensor is sampling")
    (lidar_id, _), *others = Counter(who for who, _ in packets).most_common()
    device = devices.get(lidar_id)
    return Lvx2(
        "" if device is None else device[0],
        tuple(packet for who, packet in packets if who == lidar_id),
        None if device is None else device[1],
        1 + len(others),
        cut_off,
    )


def _devices(
    path: Path, content: bytes
) -> tuple[dict[int, tuple[str, tuple[Float, Float] | None]], int]:
    """Return serial and mounting of each sensor by its number, and where the frames begin."""
    at = _PUBLIC.size + _PRIVATE.size
    if not content.startswith(_SIGNATURE):
        raise BadFile(path, "is no LVX2 file (its signature is missing)", _AGAIN)
    if len(content) < at:
        raise BadFile(path, "ends within its header", _AGAIN)
    _, version, *_, magic = _PUBLIC.unpack_from(content)
    if magic != _MAGIC or version != 2:
        raise BadFile(path, f"is LVX of version {version}, not 2", "convert it with Livox Viewer 2")
    _, count = _PRIVATE.unpack_from(content, _PUBLIC.size)
    if len(content) < at + count * _DEVICE.size:
        raise BadFile(path, "ends within its list of sensors", _AGAIN)
    devices: dict[int, tuple[str, tuple[Float, Float] | None]] = {}
    for _ in range(count):
        serial, _, lidar_id, _, _, enabled, roll, pitch, yaw, *place = _DEVICE.unpack_from(
            content, at
        )
        turn = rotation_from_euler(*np.radians([roll, pitch, yaw]))
        known = bool(enabled) and any((roll, pitch, yaw, *place))
        text = serial.split(b"\0")[0].decode("ascii", "replace")
        devices[lidar_id] = (text, (turn, np.array(place)) if known else None)
        at += _DEVICE.size
    return devices, at


def _packages(content: bytes, at: int, end: int, packets: list[tuple[int, RecordedPacket]]) -> bool:
    """Append the packages of a frame; return False where the last one is not whole."""
    while at < end:
        if at + _PACKAGE.size > end:
            return False
        version, lidar_id, _, _, stamp_ns, number, data_type, length, _ = _PACKAGE.unpack_from(
            content, at
        )
        at += _PACKAGE.size
        size = POINT_BYTES.get(data_type)
        if version != 0 or size is None or length % size or at + length > end:
            return False
        if length:
            interval_ns = (length // size - 1) * POINT_INTERVAL_NS
            payload = content[at : at + length]
            packet = RecordedPacket(stamp_ns, interval_ns, number, data_type, payload)
            packets.append((lidar_id, packet))
        at += length
    return True


def write_lvx2(path: Path, packets: Sequence[RecordedPacket], serial: str = "") -> None:
    """Write packets of one MID-360 as an LVX2 file; times and points stay as they are."""
    lidar_id = 1
    parts = [
        _PUBLIC.pack(_SIGNATURE, 2, 0, 0, 0, _MAGIC),
        _PRIVATE.pack(_FRAME_MS, 1),
        _DEVICE.pack(serial.encode("ascii")[:15], b"", lidar_id, 0, _MID360, 0, *[0.0] * 6),
    ]
    at = sum(map(len, parts))
    first_ns = packets[0].stamp_ns if packets else 0

    def frame_of(packet: RecordedPacket) -> int:
        return (packet.stamp_ns - first_ns) // (_FRAME_MS * 1_000_000)

    for index, (_, group) in enumerate(groupby(packets, frame_of)):
        body = b"".join(
            _PACKAGE.pack(
                0, lidar_id, 0, 0, one.stamp_ns, one.number, one.data_type, len(one.payload), 0
            )
            + one.payload
            for one in group
        )
        following = at + _FRAME.size + len(body)
        parts += [_FRAME.pack(at, following, index), body]
        at = following
    path.write_bytes(b"".join(parts))
