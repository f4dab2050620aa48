"""Probabilistic grid map with free-space carving (Shi et al. 2025, Sec. III-B.2; M_g).

Each cell holds the log-odds of being occupied. A return adds to its cell and every cell that its
ray passed loses: fog and strays that later rays pass through vanish. Rays are walked cell by cell
(Amanatides and Woo, 1987) inside a box round the hub; where only the cells of rings will be asked
for, only what rays pass of the rings' tube is walked, and those cells end up the same.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from perception.values import Float, Float32
from perception.voxel_hash import compiled

#: Log-odds of a hit, of a pass, and where they saturate (OctoMap's figures).
HIT = math.log(0.7 / 0.3)
PASS = math.log(0.4 / 0.6)
LOWEST, HIGHEST = -2.0, 3.5


class Tube(NamedTuple):
    """Where rings lie: cells within ``margin_m`` of a cylinder about an axis."""

    start_w: Float
    axis_w: Float
    """(3,) unit"""
    length_m: float
    radius_m: float
    margin_m: float


class GridMap:
    """A cube of cells round a place."""

    def __init__(self, centre_w: Float, *, half_m: float, resolution_m: float) -> None:
        """Start with every cell unknown (log-odds 0)."""
        cells = 2 * math.ceil(half_m / resolution_m)
        self.resolution_m = resolution_m
        self._log_odds: Float32 = np.zeros((cells, cells, cells), np.float32)
        # Twice the number of the cloud that last touched a cell, one more where it was hit.
        self._stamp: NDArray[np.int32] = np.zeros((cells, cells, cells), np.int32)
        self._fused = 0
        self.restart(centre_w)

    def restart(self, centre_w: Float) -> None:
        """Forget everything, and stand round another place."""
        self.centre_w = np.array(centre_w, np.float64)
        self._corner_w = self.centre_w - 0.5 * len(self._log_odds) * self.resolution_m
        self._fused += 1
        self._oldest = 2 * self._fused

    def fuse(self, points_w: Float, origins_w: Float, tube: Tube | None = None) -> None:
        """Fuse returns (N, 3) measured from (N, 3) or (3,), world metres; in a ``tube`` only."""
        points = np.ascontiguousarray(points_w, np.float64)
        origins = np.ascontiguousarray(np.broadcast_to(origins_w, points.shape), np.float64)
        finite = np.isfinite(points).all(axis=1) & np.isfinite(origins).all(axis=1)
        if not finite.all():
            points, origins = points[finite], origins[finite]
        self._fused += 1
        scale = 1.0 / self.resolution_m
        shape = np.zeros(9)
        if tube is not None:
            shape[:3] = (tube.start_w - self._corner_w) * scale
            shape[3:6] = tube.axis_w
            shape[6:] = np.array([tube.length_m, tube.radius_m, tube.margin_m]) * scale
        stamps = np.array([self._fused, self._oldest], np.int64)
        _fuse(points, origins, self._corner_w, scale, shape, self._log_odds, self._stamp, stamps)

    def occupied(self, points_w: Float) -> NDArray[np.bool_]:
        """Return for points (..., 3) whether their cell is occupied (outside the box: no)."""
        cell = np.floor((points_w - self._corner_w) / self.resolution_m).astype(np.int64)
        fits = np.logical_and(cell >= 0, cell < self._log_odds.shape[0])
        inside = np.asarray(fits.all(axis=-1), np.bool_)
        safe = np.where(inside[..., None], cell, 0)
        where = (safe[..., 0], safe[..., 1], safe[..., 2])
        known = self._stamp[where] >= self._oldest
        value = self._log_odds[where]
        return np.asarray(inside & known & (value > 0.0), np.bool_)

    def occupied_on_rings(self, centres_w: Float, offsets_w: Float) -> NDArray[np.bool_]:
        """Return (N, M) whether the cell at each of (N, 3) centres plus (M, 3) offsets is."""
        out = np.zeros((len(centres_w), len(offsets_w)), np.bool_)
        _occupied_on_rings(
            (centres_w - self._corner_w) / self.resolution_m, offsets_w / self.resolution_m,
            self._log_odds, self._stamp, self._oldest, out,
        )  # fmt: skip
        return out

    def cell_centres(self, points_w: Float) -> Float:
        """Return the centres (K, 3) of the distinct cells that hold points (N, 3)."""
        cell = np.unique(np.floor((points_w - self._corner_w) / self.resolution_m), axis=0)
        return np.asarray(self._corner_w + (cell + 0.5) * self.resolution_m, np.float64)


@compiled
def _fuse(  # type: ignore[no-untyped-def]  # compiled
    points, origins, corner, scale, tube, odds, stamp, stamps
):
    """Fuse a cloud: first every hit, then every ray; a cell hit in this cloud is not carved by it.

    ``tube``: start, axis, length, radius, margin in cells, radius 0 for none; ``stamps``: the
    number of this cloud, and twice that of the oldest one that counts.
    """
    cells, hit = odds.shape[0], 2 * stamps[0] + 1
    for n in range(len(points)):
        i = int(np.floor((points[n, 0] - corner[0]) * scale))
        j = int(np.floor((points[n, 1] - corner[1]) * scale))
        k = int(np.floor((points[n, 2] - corner[2]) * scale))
        inside = 0 <= i < cells and 0 <= j < cells and 0 <= k < cells
        if inside and stamp[i, j, k] != hit:
            before = odds[i, j, k] if stamp[i, j, k] >= stamps[1] else 0.0
            stamp[i, j, k] = hit
            odds[i, j, k] = min(before + HIT, HIGHEST)
    start, ray, parts = np.empty(3), np.empty(3), np.empty((2, 2))
    for n in range(len(points)):
        # Part of the ray inside the box, as shares of its length.
        enter, leave = 0.0, 1.0
        for a in range(3):
            start[a] = (origins[n, a] - corner[a]) * scale
            ray[a] = (points[n, a] - origins[n, a]) * scale
            if abs(ray[a]) < 1e-12:
                if not 0.0 <= start[a] < cells:
                    enter = 2.0
                continue
            one = -start[a] / ray[a]
            other = (cells - start[a]) / ray[a]
            enter = max(enter, min(one, other))
            leave = min(leave, max(one, other))
        if enter >= leave:
            continue
        parts[0, 0], parts[0, 1], count = enter, leave, 1
        if tube[7] > 0.0:
            count = _within(start, ray, tube, parts)
        for part in range(count):
            _walk(start, ray, parts[part, 0], parts[part, 1], odds, stamp, hit, stamps[1])


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
def _walk(start, ray, enter, leave, odds, stamp, hit, oldest):  # type: ignore[no-untyped-def]  # compiled
    """Carve the cells of one ray between two shares of its length; not the last one."""
    cells = odds.shape[0]
    cell, step = np.empty(3, np.int64), np.empty(3, np.int64)
    crossing, between = np.empty(3), np.empty(3)
    for a in range(3):
        begin = start[a] + (enter + 1e-9) * ray[a]
        cell[a] = min(max(int(np.floor(begin)), 0), cells - 1)
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
            return  # the last cell holds the return itself, or ends the box
        if stamp[i, j, k] != hit:
            before = odds[i, j, k] if stamp[i, j, k] >= oldest else 0.0
            odds[i, j, k] = max(before + PASS, LOWEST)
            stamp[i, j, k] = hit - 1
        cell[axis] += step[axis]
        crossing[axis] += between[axis]
        if cell[axis] < 0 or cell[axis] >= cells:
            return


@compiled
def _occupied_on_rings(  # type: ignore[no-untyped-def]  # compiled
    centres, offsets, odds, stamp, oldest, out
):
    cells = odds.shape[0]
    for n in range(len(centres)):
        for m in range(len(offsets)):
            i = int(np.floor(centres[n, 0] + offsets[m, 0]))
            j = int(np.floor(centres[n, 1] + offsets[m, 1]))
            k = int(np.floor(centres[n, 2] + offsets[m, 2]))
            inside = 0 <= i < cells and 0 <= j < cells and 0 <= k < cells
            if inside and stamp[i, j, k] >= oldest and odds[i, j, k] > 0.0:
                out[n, m] = True
