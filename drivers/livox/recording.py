"""Point packets of a MID-360 as a recording holds them, and all their points at once.

Both of the sensor's file formats (`lvx2`, `capture`) come to this. Times stay on the sensor's own
clock; a capture knows beside it when each packet arrived.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from drivers.livox.packets import POINT_BYTES, decode_points
from perception.values import Bytes, Float, Float32

#: A MID-360 fires every 5 us; LVX2 leaves the interval of a packet out.
POINT_INTERVAL_NS = 5_000


@dataclass(frozen=True, slots=True)
class RecordedPacket:
    """One point packet; ``payload`` are the points as they lay on the wire."""

    stamp_ns: int
    """Sensor time of the first point."""
    interval_ns: int
    """From the first point to the last."""
    number: int
    data_type: int
    payload: bytes
    arrival_s: float | None = None
    """On the clock of the computer that captured (UTC); None where the format does not say."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPoints:
    """Every return of a recording, in the order measured."""

    points_l: Float32
    """(N, 3) metres, sensor FLU."""
    time_s: Float
    """(N,) sensor time."""
    arrival_s: Float | None
    """(N,) sensor time put on the clock of the computer that captured."""
    reflectivity: Bytes
    tag: Bytes


def points_of(packets: Sequence[RecordedPacket]) -> RecordedPoints:
    """Return the points of all packets; no-returns are left out.

    Packets travel with a delay that is never negative: the smallest seen puts the sensor's clock
    on the computer's.
    """
    groups: dict[tuple[int, int], list[int]] = defaultdict(list)
    for k, packet in enumerate(packets):
        groups[packet.data_type, len(packet.payload)].append(k)
    parts = [_decoded(packets, data_type, index) for (data_type, _), index in groups.items()]
    points, times, reflectivity, tag = (
        np.concatenate([np.zeros(shape, dtype), *(part[k] for part in parts if part is not None)])
        for k, (shape, dtype) in enumerate(
            (((0, 3), np.float32), ((0,), np.float64), ((0,), np.uint8), ((0,), np.uint8))
        )
    )
    order = np.argsort(times, kind="stable")
    delays = [p.arrival_s - p.stamp_ns * 1e-9 for p in packets if p.arrival_s is not None]
    arrival = times[order] + min(delays) if delays else None
    return RecordedPoints(points[order], times[order], arrival, reflectivity[order], tag[order])


def _decoded(
    packets: Sequence[RecordedPacket], data_type: int, index: list[int]
) -> tuple[Float32, Float, Bytes, Bytes] | None:
    """Return points, times, reflectivity and tags of packets of one type and size."""
    size = len(packets[index[0]].payload)
    payload = np.frombuffer(b"".join(packets[k].payload for k in index), np.uint8)
    found = decode_points(payload.reshape(len(index), size), data_type)
    if found is None:
        return None
    count = size // POINT_BYTES[data_type]
    packet = found.place // count
    first_s = np.array([packets[k].stamp_ns for k in index], np.float64) * 1e-9
    step_s = np.array([packets[k].interval_ns for k in index]) * 1e-9 / max(count - 1, 1)
    times = first_s[packet] + (found.place - packet * count) * step_s[packet]
    return found.points_l, times, found.reflectivity, found.tag
