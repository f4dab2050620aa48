"""The grid map's loops, compiled: bundles of rays, hits, the walk through the cells, rings.

A cell is two whole numbers: its log-odds in thousandths, and its mark: four times the number of
the cloud that last touched it, and the flags `EVER_HIT` and `HIT_NOW`. Places here are in cells
from the map's corner unless a name says otherwise.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from perception.values import Float
from perception.voxel_hash import EMPTY, Int64, compiled, pack, rebuild, slot_of

#: Log-odds of a hit, of a pass, and where they saturate (OctoMap's figures), in thousandths.
HIT = round(1000 * math.log(0.7 / 0.3))
PASS = round(1000 * math.log(0.4 / 0.6))
LOWEST, HIGHEST = -2000, 3500
EVER_HIT, HIT_NOW = 2, 1
HALF_DIAGONAL = 0.8661
"""Of a cell, in cells."""


class Tube(NamedTuple):
    """Where rings lie: cells within ``margin_m`` of a cylinder about an axis."""

    start_w: Float
    axis_w: Float
    """(3,) unit"""
    length_m: float
    radius_m: float
    margin_m: float

    def holds(self, other: Tube) -> bool:
        """Return whether the cells of another tube of the same radius are all in this one."""
        spare_m = self.margin_m - other.margin_m
        cosine = float(np.clip(self.axis_w @ other.axis_w, -1.0, 1.0))
        sunk_m = self.radius_m * math.sqrt(1.0 - cosine * cosine)
        for end_m in (0.0, other.length_m):
            off = other.start_w + end_m * other.axis_w - self.start_w
            along = float(off @ self.axis_w)
            aside_m = float(np.linalg.norm(off - along * self.axis_w))
            if aside_m + self.radius_m * (1.0 - cosine) > spare_m:
                return False
            if along - sunk_m < -spare_m or along + sunk_m > self.length_m + spare_m:
                return False
        return True


@compiled
def bundled(points: Float, origins: Float, corner: Float, scale: float) -> tuple[Int64, Int64]:
    """Return of each cell that holds returns the first of them, and how many there are.

    ``points``: (N, 3), world metres; ``origins``: (N, 3), or (1, 3) for all. What is not finite is
    left out.
    """
    room = 1 << 11
    keys, rows = np.full(2 * room, EMPTY, np.int64), np.zeros(2 * room, np.int64)
    first: Int64 = np.zeros(room, np.int64)
    count: Int64 = np.zeros(room, np.int64)
    key_of: Int64 = np.zeros(room, np.int64)
    found = 0
    for n in range(len(points)):
        o = n if len(origins) > 1 else 0
        total = 0.0
        for a in range(3):
            total += abs(points[n, a]) + abs(origins[o, a])
        if not total < 1e6:  # comparisons with NaN are false
            continue
        i = int(np.floor((points[n, 0] - corner[0]) * scale))
        j = int(np.floor((points[n, 1] - corner[1]) * scale))
        k = int(np.floor((points[n, 2] - corner[2]) * scale))
        key = pack(i, j, k)
        slot = slot_of(keys, key)
        if keys[slot] == key:
            count[rows[slot]] += 1
            continue
        if found == room:
            more = np.zeros(room, np.int64)
            first, count = np.append(first, more), np.append(count, more)
            key_of = np.append(key_of, more)
            room *= 2
            keys, rows = np.full(2 * room, EMPTY, np.int64), np.zeros(2 * room, np.int64)
            rebuild(keys, rows, key_of, found)
            slot = slot_of(keys, key)
        keys[slot], rows[slot] = key, found
        first[found], count[found], key_of[found] = n, 1, key
        found += 1
    return first[:found].copy(), count[:found].copy()


@compiled
def fuse(  # type: ignore[no-untyped-def]  # compiled
    points, origins, first, count, corner, scale, tube, cells, marks
):
    """Fuse a cloud: first every hit, then every ray; a cell hit in this cloud is not carved by it.

    ``first``, ``count``: of `bundled`; ``tube``: start, axis, length, radius, margin in cells,
    radius 0 for none; ``marks``: this cloud's, and that of the oldest that counts. Returns where
    (flat) cells were hit for the first time.
    """
    side = cells.shape[0]
    new, found = np.empty(len(first), np.int64), 0
    for m in range(len(first)):
        n = first[m]
        i = int(np.floor((points[n, 0] - corner[0]) * scale))
        j = int(np.floor((points[n, 1] - corner[1]) * scale))
        k = int(np.floor((points[n, 2] - corner[2]) * scale))
        if not (0 <= i < side and 0 <= j < side and 0 <= k < side):
            continue
        odds, mark = cells[i, j, k, 0], cells[i, j, k, 1]
        if mark < marks[1]:
            odds, mark = 0, 0
        if mark & EVER_HIT == 0:
            new[found] = (i * side + j) * side + k
            found += 1
        cells[i, j, k, 0] = min(odds + HIT, HIGHEST)
        cells[i, j, k, 1] = marks[0] + EVER_HIT + HIT_NOW
    start, ray, parts = np.empty(3), np.empty(3), np.empty((2, 2))
    for m in range(len(first)):
        n = first[m]
        o = n if len(origins) > 1 else 0
        # Part of the ray inside the box, as shares of its length.
        enter, leave = 0.0, 1.0
        for a in range(3):
            start[a] = (origins[o, a] - corner[a]) * scale
            ray[a] = (points[n, a] - origins[o, a]) * scale
            if abs(ray[a]) < 1e-12:
                if not 0.0 <= start[a] < side:
                    enter = 2.0
                continue
            one = -start[a] / ray[a]
            other = (side - start[a]) / ray[a]
            enter = max(enter, min(one, other))
            leave = min(leave, max(one, other))
        if enter >= leave:
            continue
        parts[0, 0], parts[0, 1], pieces = enter, leave, 1
        if tube[7] > 0.0:
            pieces = _within(start, ray, tube, parts)
        for part in range(pieces):
            _walk(start, ray, parts[part, 0], parts[part, 1], count[m] * PASS, cells, marks)
    return new[:found].copy()


@compiled
def _within(start, ray, tube, parts):  # type: ignore[no-untyped-def]  # compiled
    """Cut ``parts[0]`` of a ray down to what lies in the tube; return how many parts are left."""
    enter, leave = parts[0, 0], parts[0, 1]
    along, flow = 0.0, 0.0
    for a in range(3):
        along += (start[a] - tube[a]) * tube[3 + a]
        flow += ray[a] * tube[3 + a]
    if abs(flow) > 1e-12:
        one, other = (-tube[8] - along) / flow, (tube[6] + tube[8] - along) / flow
        enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
    # Squared distance from the axis: c + 2 b t + a t^2.
    a2, b, c = 0.0, 0.0, 0.0
    for a in range(3):
        off, run = start[a] - tube[a] - along * tube[3 + a], ray[a] - flow * tube[3 + a]
        a2, b, c = a2 + run * run, b + off * run, c + off * off
    if a2 < 1e-12 or enter >= leave:
        return 0
    wide, narrow = tube[7] + tube[8], max(tube[7] - tube[8], 0.0)
    root = b * b - a2 * (c - wide * wide)
    if root <= 0.0:
        return 0
    root = math.sqrt(root)
    enter, leave = max(enter, (-b - root) / a2), min(leave, (-b + root) / a2)
    if enter >= leave:
        return 0
    root = b * b - a2 * (c - narrow * narrow)
    if root <= 0.0:
        parts[0, 0], parts[0, 1] = enter, leave
        return 1
    root, count = math.sqrt(root), 0
    first, last = (-b - root) / a2, (-b + root) / a2
    if enter < min(leave, first):
        parts[count, 0], parts[count, 1] = enter, min(leave, first)
        count += 1
    if max(enter, last) < leave:
        parts[count, 0], parts[count, 1] = max(enter, last), leave
        count += 1
    return count


@compiled
def _walk(start, ray, enter, leave, loss, cells, marks):  # type: ignore[no-untyped-def]  # compiled
    """Carve the cells of one ray between two shares of its length (Amanatides and Woo, 1987).

    Not the last one: it holds the return itself.
    """
    side = cells.shape[0]
    cell, step = np.empty(3, np.int64), np.empty(3, np.int64)
    crossing, between = np.empty(3), np.empty(3)
    for a in range(3):
        begin = start[a] + (enter + 1e-9) * ray[a]
        cell[a] = min(max(int(np.floor(begin)), 0), side - 1)
        step[a] = 1 if ray[a] > 0 else -1
        if abs(ray[a]) < 1e-12:
            crossing[a], between[a] = np.inf, np.inf
        else:
            border = cell[a] + (1 if ray[a] > 0 else 0)
            crossing[a] = (border - start[a]) / ray[a]
            between[a] = abs(1.0 / ray[a])
    while True:
        i, j, k = cell[0], cell[1], cell[2]
        axis = 0
        if crossing[1] < crossing[axis]:
            axis = 1
        if crossing[2] < crossing[axis]:
            axis = 2
        if crossing[axis] >= leave:
            return
        odds, mark = cells[i, j, k, 0], cells[i, j, k, 1]
        if mark < marks[1]:
            odds, mark = 0, 0
        if mark != marks[0] + EVER_HIT + HIT_NOW:
            cells[i, j, k, 0] = max(odds + loss, LOWEST)
            cells[i, j, k, 1] = marks[0] + (mark & EVER_HIT)
        cell[axis] += step[axis]
        crossing[axis] += between[axis]
        if cell[axis] < 0 or cell[axis] >= side:
            return


@compiled
def mark_rings(centres, ring, frame, shape, hit, cells, out):  # type: ignore[no-untyped-def]  # compiled
    """Mark in ``out`` (N, M) the places of rings whose cell is occupied.

    Instead of looking up every place of every ring, each cell ever ``hit`` is held against the few
    places that can lie in it: most cells that rings meet were never hit. ``centres``: (N, 3);
    ``ring``: (M, 3) about a centre; ``frame``: (3, 3) rows along the normal, towards the ring's
    first place, a quarter turn on; ``shape``: step of the centres, radius, turn of a step.
    """
    side, step, radius, turn = cells.shape[0], shape[0], shape[1], shape[2]
    reach = math.asin(min(1.0, HALF_DIAGONAL / max(radius - HALF_DIAGONAL, 1.0)))
    local = np.empty(3)
    for h in range(len(hit)):
        i, j, k = hit[h] // (side * side), hit[h] // side % side, hit[h] % side
        if cells[i, j, k, 0] <= 0:
            continue
        for a in range(3):
            local[a] = (
                frame[a, 0] * (i + 0.5 - centres[0, 0])
                + frame[a, 1] * (j + 0.5 - centres[0, 1])
                + frame[a, 2] * (k + 0.5 - centres[0, 2])
            )
        if abs(math.hypot(local[1], local[2]) - radius) > HALF_DIAGONAL:
            continue
        nearest = max(0, math.ceil((local[0] - HALF_DIAGONAL) / step))
        farthest = min(len(centres) - 1, math.floor((local[0] + HALF_DIAGONAL) / step))
        bearing = math.atan2(local[2], local[1])
        for round_ in range(2):  # a ring's last step is a shorter one
            about = bearing + 2 * math.pi * round_
            first = max(0, math.ceil((about - reach) / turn))
            last = min(len(ring) - 1, math.floor((about + reach) / turn))
            for n in range(nearest, farthest + 1):
                for m in range(first, last + 1):
                    if (
                        np.floor(centres[n, 0] + ring[m, 0]) == i
                        and np.floor(centres[n, 1] + ring[m, 1]) == j
                        and np.floor(centres[n, 2] + ring[m, 2]) == k
                    ):
                        out[n, m] = True
