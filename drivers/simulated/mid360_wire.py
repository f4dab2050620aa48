"""Packs points and IMU samples into the packets of a MID-360, quirks included. Vectorised."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from drivers.livox.packets import (
    HEADER,
    HEADER_BYTES,
    IMU_PACKET_BYTES,
    POINT_DTYPES,
    POINTS_PER_PACKET,
    DataType,
)
from perception.values import Bytes, Float32

POINT = POINT_DTYPES[DataType.CARTESIAN_MM]
PACKET = np.dtype(
    [
        ("version", "u1"),
        ("length", "<u2"),
        ("interval", "<u2"),
        ("points", "<u2"),
        ("number", "<u2"),
        ("frame", "u1"),
        ("data_type", "u1"),
        ("time_type", "u1"),
        ("reserved", "V12"),
        ("crc", "<u4"),
        ("stamp_ns", "<u8"),
        ("point", POINT, POINTS_PER_PACKET),
    ]
)
_OUTSIDE_WINDOW = 60
#: A real unit marks some rays without return as outside its window; here every so many.
_MARKED_EVERY = 64

Records = NDArray[np.void]


def pack_points(
    points_l: Float32, reflectivity: Bytes, tag: Bytes, returned: NDArray[np.bool_]
) -> Records:
    """Return (N,) points as they lie in a packet: millimetres, no-returns as zeros."""
    raw = np.zeros((len(points_l), POINT.itemsize), np.uint8)
    raw[::_MARKED_EVERY, -2] = _OUTSIDE_WINDOW
    # By bytes rather than by fields, which lie unaligned: that takes half the time.
    index = np.flatnonzero(returned)
    kept = np.empty((len(index), POINT.itemsize), np.uint8)
    millimetres = np.rint(np.asarray(points_l, np.float32).take(index, axis=0) * np.float32(1000))
    kept[:, :-2] = millimetres.astype("<i4").view(np.uint8)
    kept[:, -2] = reflectivity.take(index)
    kept[:, -1] = tag.take(index)
    raw[index] = kept
    return raw.view(POINT).reshape(-1)


def pack_packets(records: Records, first_ns: int, interval_ns: int, first_number: int) -> Records:
    """Return (P,) packets of 96 points each.

    Args:
        records: (P * 96,) from `pack_points`.
        first_ns: sensor time of the first point.
        interval_ns: from one point to the next.
        first_number: running number of the first packet; it wraps at 65536.
    """
    count = len(records) // POINTS_PER_PACKET
    packets = np.zeros(count, PACKET)
    packets["length"] = PACKET.itemsize
    packets["interval"] = (POINTS_PER_PACKET - 1) * interval_ns // 100
    packets["points"] = POINTS_PER_PACKET
    packets["number"] = (first_number + np.arange(count)) & 0xFFFF
    packets["data_type"] = DataType.CARTESIAN_MM
    packets["stamp_ns"] = first_ns + np.arange(count) * (POINTS_PER_PACKET * interval_ns)
    # Firmware 13.18.02.44 leaves the check sum of point packets and the frame count at zero.
    packets["point"] = records.reshape(count, POINTS_PER_PACKET)
    return packets


def pack_imu(
    stamp_ns: int,
    number: int,
    gyro_rps: tuple[float, float, float],
    acc_g: tuple[float, float, float],
) -> bytes:
    """Return an IMU packet; its check sum is right, as a real unit's."""
    body = struct.pack("<6f", *gyro_rps, *acc_g)
    tail = struct.pack("<Q", stamp_ns) + body
    packet = bytearray(HEADER_BYTES) + body
    HEADER.pack_into(
        packet, 0, 0, IMU_PACKET_BYTES, 0, 1, number & 0xFFFF, 0, 0, 0, zlib.crc32(tail), stamp_ns
    )
    return bytes(packet)
