"""What is near, seen now or earlier in this flight: the guard's picture of the world.

Voxels of 0.5 m that were hit are kept for the whole flight, so that a blade stays an obstacle
after it has left the field of view. One stray return is no obstacle: a voxel counts when it or a
neighbour was hit again, in the same scan or the next. Ground counts like everything else.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from perception.values import Float, Float32
from perception.voxel_hash import EMPTY, Int64, compiled, pack, rebuild, slot_of

Int32 = NDArray[np.int32]
Number = TypeVar("Number", np.int64, np.int32, np.float32, np.float64)

#: Hits after which the mean of a voxel no longer follows new returns.
MEAN_OVER = 32


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """A blade that every scan shows anew.

    The vehicle's position wanders, and each earlier place of the blade would stay beside it as an
    obstacle that is not there.
    """

    root_w: Float
    """(3,)"""
    tip_w: Float
    """(3,)"""
    reach_m: float
    """What is nearer to its axis is the blade's."""
    not_before_s: float
    """What of it was last seen earlier is left out."""


class OccupancyMemory:
    """Voxels found occupied in this flight, and the clearance they leave."""

    def __init__(
        self, *, voxel_m: float = 0.5, ignore_within_m: float = 1.5, max_range_m: float = 105.0
    ) -> None:
        """Start empty.

        ``ignore_within_m``: returns this near the sensor are fog or the airframe itself: the
        blind range plus the airframe's radius. ``max_range_m``: farther ones cannot be.
        """
        self._voxel_m = voxel_m
        self._ignore_within_m = ignore_within_m
        self._max_range_m = max_range_m
        self._scan = 0
        self._count = 0
        self._solid_count = 0
        self._live: Float32 = np.empty((0, 3), np.float32)
        self._keys = np.full(1 << 17, EMPTY, np.int64)
        self._rows = np.zeros(1 << 17, np.int64)
        self._key: Int64 = np.zeros(1 << 15, np.int64)
        self._hits: Int32 = np.zeros((1 << 15, 2), np.int32)
        self._mean: Float32 = np.zeros((1 << 15, 3), np.float32)
        self._stamp: Float = np.zeros(1 << 15, np.float64)
        self._solid: Int64 = np.zeros(1 << 15, np.int64)

    def _grow(self) -> None:
        capacity = 2 * len(self._key)
        self._key = _twice(self._key)
        self._hits = _twice(self._hits)
        self._mean = _twice(self._mean)
        self._stamp = _twice(self._stamp)
        self._solid = _twice(self._solid)
        if len(self._keys) < 2 * capacity:
            self._keys = np.full(4 * capacity, EMPTY, np.int64)
            self._rows = np.zeros(4 * capacity, np.int64)
            rebuild(self._keys, self._rows, self._key, self._count)

    @property
    def voxels(self) -> int:
        """How many voxels count as occupied."""
        return self._solid_count

    def update(self, points_w: Float, stamp_s: float, origin_w: Float | None = None) -> None:
        """Take in one scan.

        ``points_w``: (N, 3) world metres; ``origin_w``: (3,) the sensor's place, for leaving out
        what is too near or impossibly far (None: everything finite is used).
        """
        points = np.ascontiguousarray(points_w, np.float64)
        self._scan += 1
        while self._count + len(points) > len(self._key):
            self._grow()
        near, far = self._ignore_within_m, self._max_range_m
        origin = np.zeros(3) if origin_w is None else np.asarray(origin_w, np.float64)
        if origin_w is None:
            near, far = -1.0, 1e5
        row_of_point = np.empty(len(points), np.int64)
        self._count = _insert(
            points, origin, near, far, 1.0 / self._voxel_m, self._scan, stamp_s,
            self._keys, self._rows, self._key, self._hits, self._mean, self._stamp,
            self._count, row_of_point,
        )  # fmt: skip
        live = np.empty((len(points), 3), np.float32)
        self._solid_count, live_count = _confirm(
            points, row_of_point, self._scan, self._keys, self._rows, self._key, self._hits,
            self._solid, self._solid_count, live,
        )  # fmt: skip
        self._live = live[:live_count]

    def nearest(self, position_w: Float) -> tuple[float, Float] | None:
        """Return distance and place of the nearest point of the live scan, None for nothing."""
        if not len(self._live):
            return None
        index, distance2 = _nearest(self._live, np.asarray(position_w, np.float64))
        return float(np.sqrt(distance2)), self._live[index].astype(np.float64)

    def around(
        self,
        position_w: Float,
        radius_m: float,
        max_points: int = 2000,
        *,
        not_before_s: float = float("-inf"),
        followed: Followed | None = None,
    ) -> Float32:
        """Return occupied places (N, 3) within a radius, one a voxel, at most ``max_points``.

        Where there are more, the nearest half is kept whole and the rest is thinned evenly.
        ``not_before_s`` leaves out what was last seen earlier; ``followed`` what of a blade that is
        being followed was seen earlier.
        """
        line: Float = np.zeros((2, 3))
        reach_m, since_s = -1.0, not_before_s
        if followed is not None:
            line = np.stack([followed.root_w, followed.tip_w])
            reach_m, since_s = followed.reach_m, followed.not_before_s
        found, distance2 = _around(
            self._solid, self._solid_count, self._mean, self._stamp,
            np.asarray(position_w, np.float64), radius_m * radius_m, not_before_s,
            line, reach_m, since_s,
        )  # fmt: skip
        if len(found) <= max_points:
            return np.asarray(found, np.float32)
        order = np.argsort(distance2)
        half = max_points // 2
        spread = np.linspace(half, len(order) - 1, max_points - half).astype(np.int64)
        return np.asarray(found[np.concatenate([order[:half], order[spread]])], np.float32)


def _twice(array: NDArray[Number]) -> NDArray[Number]:
    return np.concatenate([array, np.zeros_like(array)])


class RepeatedScans:
    """Notices a sensor that delivers the same scan again and again."""

    def __init__(self, *, tolerated: int = 2) -> None:
        """``tolerated``: so many repetitions in a row may be a hiccup of the link."""
        self._tolerated = tolerated
        self._recent: list[int] = []
        self._repeats = 0

    def update(self, points_l: Float32) -> bool:
        """Take in a scan as the sensor gave it (sensor frame); say whether it has got stuck.

        Live returns carry millimetres of noise: an equal scan, or one of a loop of four, is no
        new measurement. An empty scan says nothing.
        """
        if not len(points_l):
            return self._repeats > self._tolerated
        digest = zlib.crc32(np.ascontiguousarray(points_l[::7]).tobytes())
        self._repeats = self._repeats + 1 if digest in self._recent else 0
        self._recent = [*self._recent[-3:], digest]
        return self._repeats > self._tolerated


@compiled
def _insert(
    points: Float, origin: Float, near: float, far: float, per_metre: float, scan: int,
    stamp: float, keys: Int64, rows: Int64, key: Int64, hits: Int32, mean: Float32,
    stamps: Float, count: int, row_of_point: Int64,
) -> int:  # fmt: skip
    near2 = near * near if near > 0 else -1.0
    far2 = far * far
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        range2 = (x - origin[0]) ** 2 + (y - origin[1]) ** 2 + (z - origin[2]) ** 2
        # Written so that NaN is refused, too.
        if not (range2 >= near2 and range2 <= far2):
            row_of_point[n] = -1
            continue
        one = pack(
            int(np.floor(x * per_metre)), int(np.floor(y * per_metre)), int(np.floor(z * per_metre))
        )
        slot = slot_of(keys, one)
        if keys[slot] == EMPTY:
            keys[slot] = one
            rows[slot] = count
            key[count] = one
            hits[count, 0] = 0
            hits[count, 1] = scan
            count += 1
        row = rows[slot]
        row_of_point[n] = row
        if hits[row, 0] >= 0:
            # A doubtful voxel forgets hits that are older than the last scan.
            if hits[row, 1] < scan - 1:
                hits[row, 0] = 0
            hits[row, 0] += 1
            weight = 1.0 / min(hits[row, 0], MEAN_OVER)
        else:
            weight = 1.0 / MEAN_OVER
        hits[row, 1] = scan
        stamps[row] = stamp
        mean[row, 0] += weight * (x - mean[row, 0])
        mean[row, 1] += weight * (y - mean[row, 1])
        mean[row, 2] += weight * (z - mean[row, 2])
    return count


@compiled
def _confirm(
    points: Float, row_of_point: Int64, scan: int, keys: Int64, rows: Int64, key: Int64,
    hits: Int32, solid: Int64, solid_count: int, live: Float32,
) -> tuple[int, int]:  # fmt: skip
    """Mark voxels with two hits in their neighbourhood solid (hits -1); gather the live points."""
    live_count = 0
    for n in range(len(points)):
        row = row_of_point[n]
        if row < 0:
            continue
        if hits[row, 0] >= 2 or (
            hits[row, 0] > 0 and _has_neighbour(key[row], keys, rows, hits, scan)
        ):
            hits[row, 0] = -1
            solid[solid_count] = row
            solid_count += 1
        if hits[row, 0] == -1:
            live[live_count, 0] = points[n, 0]
            live[live_count, 1] = points[n, 1]
            live[live_count, 2] = points[n, 2]
            live_count += 1
    return solid_count, live_count


@compiled
def _has_neighbour(one: int, keys: Int64, rows: Int64, hits: Int32, scan: int) -> bool:
    """Say whether one of the 26 voxels round this one was hit in this scan or the last."""
    for i in range(-1, 2):
        for j in range(-1, 2):
            for k in range(-1, 2):
                other = one + (i << 42) + (j << 21) + k
                if other == one:
                    continue
                slot = slot_of(keys, other)
                if keys[slot] != EMPTY and hits[rows[slot], 1] >= scan - 1:
                    return True
    return False


@compiled
def _nearest(points: Float32, position: Float) -> tuple[int, float]:
    best, best2 = 0, np.inf
    for n in range(len(points)):
        d2 = (
            (points[n, 0] - position[0]) ** 2
            + (points[n, 1] - position[1]) ** 2
            + (points[n, 2] - position[2]) ** 2
        )
        if d2 < best2:
            best, best2 = n, d2
    return best, best2


@compiled
def _around(
    solid: Int64, count: int, mean: Float32, stamps: Float, position: Float, radius2: float,
    not_before: float, line: Float, reach: float, since: float,
) -> tuple[Float32, Float]:  # fmt: skip
    found = np.empty((count, 3), np.float32)
    distance2 = np.empty(count)
    n = 0
    for index in range(count):
        row = solid[index]
        dx = mean[row, 0] - position[0]
        dy = mean[row, 1] - position[1]
        dz = mean[row, 2] - position[2]
        d2 = dx * dx + dy * dy + dz * dz
        if d2 <= radius2 and stamps[row] >= not_before:
            if stamps[row] < since and _beside(mean[row], line) <= reach:
                continue
            found[n, 0], found[n, 1], found[n, 2] = mean[row, 0], mean[row, 1], mean[row, 2]
            distance2[n] = d2
            n += 1
    return found[:n], distance2[:n]


@compiled
def _beside(place: Float32, line: Float) -> float:
    """Return the distance of a place from a line between two points (2, 3)."""
    along, length2, apart2 = 0.0, 0.0, 0.0
    for k in range(3):
        axis = line[1, k] - line[0, k]
        along += (place[k] - line[0, k]) * axis
        length2 += axis * axis
    share = min(max(along / max(length2, 1e-9), 0.0), 1.0)
    for k in range(3):
        off = place[k] - line[0, k] - share * (line[1, k] - line[0, k])
        apart2 += off * off
    return float(np.sqrt(apart2))
