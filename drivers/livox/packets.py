"""Data packets of a MID-360: point types 1-3 and IMU (type 0), as NumPy sees them.

A packet is a 36-byte header and up to 96 points. The header is checked one by one as packets
arrive (`read_header`); points are decoded a scan at a time (`decode_points`), since a NumPy call
costs the same for one packet as for two hundred. Untrusted bytes: None, never an exception.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from perception.values import Bytes, Float32

HEADER_BYTES = 36
POINTS_PER_PACKET = 96
#: version, length, interval, points, number, frame, data type, time type, crc, time stamp
HEADER = struct.Struct("<BHHHHBBB12xIQ")
_CRC_FROM = 28
#: From point to point: of a MID-360, and what a packet may state.
_NOMINAL_NS = 5_000
_FASTEST_NS, _SLOWEST_NS = 500, 50_000
_IMU = struct.Struct("<6f")


class DataType(IntEnum):
    """What a packet carries."""

    IMU = 0
    CARTESIAN_MM = 1
    CARTESIAN_CM = 2
    SPHERICAL = 3


IMU_PACKET_BYTES = HEADER_BYTES + _IMU.size

#: One point as it lies in the packet.
POINT_DTYPES = {
    DataType.CARTESIAN_MM: np.dtype([("xyz", "<i4", 3), ("reflectivity", "u1"), ("tag", "u1")]),
    DataType.CARTESIAN_CM: np.dtype([("xyz", "<i2", 3), ("reflectivity", "u1"), ("tag", "u1")]),
    DataType.SPHERICAL: np.dtype(
        [
            ("depth", "<u4"),
            ("zenith", "<u2"),
            ("azimuth", "<u2"),
            ("reflectivity", "u1"),
            ("tag", "u1"),
        ]
    ),
}
#: Size of a point by data type.
POINT_BYTES: dict[int, int] = {kind.value: dtype.itemsize for kind, dtype in POINT_DTYPES.items()}
_METRES = {DataType.CARTESIAN_MM: np.float32(1e-3), DataType.CARTESIAN_CM: np.float32(1e-2)}


class Header(NamedTuple):
    """What is needed of a point packet's header."""

    data_type: int
    points: int
    number: int
    """Running number, wraps at 65536."""
    stamp_ns: int
    """Sensor time of the first point."""
    interval_ns: int
    """From the first point to the last."""


class Points(NamedTuple):
    """Returns of many packets, in the order measured; the rest is left out."""

    points_l: Float32
    """(N, 3) metres, sensor FLU."""
    reflectivity: Bytes
    tag: Bytes
    place: NDArray[np.intp]
    """(N,) place of each point among all points of the packets: packet * points + point."""


@dataclass(frozen=True, slots=True)
class ImuSample:
    """One sample of the built-in IMU, sensor FLU."""

    stamp_ns: int
    """Sensor time."""
    gyro_rps: tuple[float, float, float]
    acc_g: tuple[float, float, float]


def read_header(
    buffer: bytes | bytearray | memoryview, size: int, *, summed: bool = True
) -> Header | None:
    """Return the header of a point packet of ``size`` bytes, or None where it is not one.

    The check sum is 0 in point packets of today's firmware; another value must be right, unless
    ``summed`` says that it is not looked at.
    """
    if not HEADER_BYTES < size <= len(buffer):
        return None
    version, length, interval, points, number, _, data_type, _, crc, stamp_ns = HEADER.unpack_from(
        buffer
    )
    point_bytes = POINT_BYTES.get(data_type)
    if point_bytes is None or version != 0 or length != size:
        return None
    if not points or HEADER_BYTES + points * point_bytes != size:
        return None
    if summed and crc and zlib.crc32(memoryview(buffer)[_CRC_FROM:size]) != crc:
        return None
    interval_ns = interval * 100
    if not _FASTEST_NS * points < interval_ns < _SLOWEST_NS * points:
        # The field says nothing, or is of another unit.
        interval_ns = _NOMINAL_NS * (points - 1)
    return Header(data_type, points, number, stamp_ns, interval_ns)


def decode_imu(datagram: bytes) -> ImuSample | None:
    """Return the sample in an IMU packet, or None."""
    if len(datagram) != IMU_PACKET_BYTES:
        return None
    version, length, _, points, _, _, data_type, _, crc, stamp_ns = HEADER.unpack_from(datagram)
    if version != 0 or length != IMU_PACKET_BYTES or points != 1 or data_type != DataType.IMU:
        return None
    if crc and zlib.crc32(datagram[_CRC_FROM:]) != crc:
        return None
    gx, gy, gz, ax, ay, az = _IMU.unpack_from(datagram, HEADER_BYTES)
    if not all(map(math.isfinite, (gx, gy, gz, ax, ay, az))):
        return None
    return ImuSample(stamp_ns, (gx, gy, gz), (ax, ay, az))


def decode_points(payload: Bytes, data_type: int) -> Points | None:
    """Return the returns in many packets' points.

    Args:
        payload: (P, points * point size) bytes behind the headers of packets of one type and size.
        data_type: 1, 2 or 3; None is returned for another one, or for a broken size.

    A no-return is (0, 0, 0) with reflectivity 0, a mark outside the configured window (0, 0, 0)
    with reflectivity 60: both are left out. The tag is kept.
    """
    dtype = POINT_DTYPES.get(DataType(data_type)) if data_type in POINT_BYTES else None
    if dtype is None or payload.ndim != 2 or payload.shape[1] % dtype.itemsize:
        return None
    raw = np.ascontiguousarray(payload).reshape(-1, dtype.itemsize)
    points = raw.view(dtype).reshape(-1)
    if data_type == DataType.SPHERICAL:
        place = np.flatnonzero(points["depth"])
        kept = raw.take(place, axis=0)
        found = kept.view(dtype).reshape(-1)
        points_l = _from_spherical(found["depth"], found["zenith"], found["azimuth"])
    else:
        xyz = points["xyz"]
        place = np.flatnonzero(xyz[:, 0] | xyz[:, 1] | xyz[:, 2])
        kept = raw.take(place, axis=0)
        # Fields of 14 bytes lie unaligned: copied out first, they convert three times as fast.
        whole = np.ascontiguousarray(kept[:, :-2]).view(xyz.dtype)
        points_l = whole.astype(np.float32)
        points_l *= _METRES[DataType(data_type)]
    return Points(points_l, kept[:, -2].copy(), kept[:, -1].copy(), place)


def _from_spherical(
    depth_mm: NDArray[np.uint32], zenith: NDArray[np.uint16], azimuth: NDArray[np.uint16]
) -> Float32:
    """Return (N, 3) metres; zenith counts from straight up, both in 0.01 deg."""
    range_m = depth_mm.astype(np.float32) * np.float32(1e-3)
    hundredth = np.float32(np.pi / 18000)
    theta, phi = zenith * hundredth, azimuth * hundredth
    level_m = range_m * np.sin(theta)
    return np.stack(
        [level_m * np.cos(phi), level_m * np.sin(phi), range_m * np.cos(theta)], axis=1
    ).astype(np.float32)
