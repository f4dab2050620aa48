"""Probabilistic grid map with free-space carving (Shi et al. 2025, Sec. III-B.2; M_g).

Each cell holds the log-odds of being occupied. A return adds to its cell and every cell that its
ray passed loses: fog and strays that later rays pass through vanish. Rays are walked cell by cell
(Amanatides and Woo, 1987) inside a box round the hub.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from perception.values import Float, Float32
from perception.voxel_hash import compiled

#: Log-odds of a hit, of a pass, and where they saturate (OctoMap's figures).
HIT = math.log(0.7 / 0.3)
PASS = math.log(0.4 / 0.6)
LOWEST, HIGHEST = -2.0, 3.5


class GridMap:
    """A cube of cells round a place."""

    def __init__(self, centre_w: Float, *, half_m: float, resolution_m: float) -> None:
        """Start with every cell unknown (log-odds 0)."""
        cells = 2 * math.ceil(half_m / resolution_m)
        self.centre_w = np.asarray(centre_w, np.float64).copy()
        self.resolution_m = resolution_m
        self._corner_w = self.centre_w - 0.5 * cells * resolution_m
        self._log_odds: Float32 = np.zeros((cells, cells, cells), np.float32)
        self._hit_in: NDArray[np.int32] = np.zeros((cells, cells, cells), np.int32)
        self._fused = 0

    def fuse(self, points_w: Float, origins_w: Float) -> None:
        """Fuse returns (N, 3) measured from (N, 3) or (3,), world metres."""
        points = np.ascontiguousarray(points_w, np.float64)
        origins = np.ascontiguousarray(np.broadcast_to(origins_w, points.shape), np.float64)
        finite = np.isfinite(points).all(axis=1) & np.isfinite(origins).all(axis=1)
        if not finite.all():
            points, origins = points[finite], origins[finite]
        self._fused += 1
        scale = 1.0 / self.resolution_m
        _fuse(
            (points - self._corner_w) * scale, (origins - self._corner_w) * scale,
            self._log_odds, self._hit_in, self._fused,
        )  # fmt: skip

    def occupied(self, points_w: Float) -> NDArray[np.bool_]:
        """Return for points (..., 3) whether their cell is occupied (outside the box: no)."""
        cell = np.floor((points_w - self._corner_w) / self.resolution_m).astype(np.int64)
        fits = np.logical_and(cell >= 0, cell < self._log_odds.shape[0])
        inside = np.asarray(fits.all(axis=-1), np.bool_)
        safe = np.where(inside[..., None], cell, 0)
        value = self._log_odds[safe[..., 0], safe[..., 1], safe[..., 2]]
        return np.asarray(np.logical_and(inside, value > 0.0), np.bool_)

    def cell_centres(self, points_w: Float) -> Float:
        """Return the centres (K, 3) of the distinct cells that hold points (N, 3)."""
        cell = np.unique(np.floor((points_w - self._corner_w) / self.resolution_m), axis=0)
        return np.asarray(self._corner_w + (cell + 0.5) * self.resolution_m, np.float64)


@compiled
def _fuse(
    points: Float, origins: Float, odds: Float32, hit_in: NDArray[np.int32], fused: int
) -> None:
    """Walk every ray in cell units; a cell hit in this cloud is not carved by it."""
    cells = odds.shape[0]
    for n in range(len(points)):
        i, j, k = (
            int(np.floor(points[n, 0])), int(np.floor(points[n, 1])), int(np.floor(points[n, 2]))
        )  # fmt: skip
        inside = 0 <= i < cells and 0 <= j < cells and 0 <= k < cells
        if inside and hit_in[i, j, k] != fused:
            hit_in[i, j, k] = fused
            odds[i, j, k] = min(odds[i, j, k] + HIT, HIGHEST)
    ray = np.empty(3)
    cell = np.empty(3, np.int64)
    step = np.empty(3, np.int64)
    crossing = np.empty(3)
    between = np.empty(3)
    for n in range(len(points)):
        # Part of the ray inside the box, as shares of its length.
        enter, leave = 0.0, 1.0
        for a in range(3):
            ray[a] = points[n, a] - origins[n, a]
            if abs(ray[a]) < 1e-12:
                if not 0.0 <= origins[n, a] < cells:
                    enter = 2.0
                continue
            one = -origins[n, a] / ray[a]
            other = (cells - origins[n, a]) / ray[a]
            enter = max(enter, min(one, other))
            leave = min(leave, max(one, other))
        if enter >= leave:
            continue
        for a in range(3):
            start = origins[n, a] + (enter + 1e-9) * ray[a]
            cell[a] = min(max(int(np.floor(start)), 0), cells - 1)
            step[a] = 1 if ray[a] > 0 else -1
            if abs(ray[a]) < 1e-12:
                crossing[a], between[a] = np.inf, np.inf
            else:
                border = cell[a] + (1 if ray[a] > 0 else 0)
                crossing[a] = (border - origins[n, a]) / ray[a]
                between[a] = abs(1.0 / ray[a])
        while True:
            i, j, k = cell[0], cell[1], cell[2]
            axis = 0
            if crossing[1] < crossing[axis]:
                axis = 1
            if crossing[2] < crossing[axis]:
                axis = 2
            if crossing[axis] >= leave:
                break  # the last cell holds the return itself, or ends the box
            if hit_in[i, j, k] != fused:
                odds[i, j, k] = max(odds[i, j, k] + PASS, LOWEST)
            cell[axis] += step[axis]
            crossing[axis] += between[axis]
            if cell[axis] < 0 or cell[axis] >= cells:
                break
