"""Probabilistic grid map with free-space carving (Shi et al. 2025, Sec. III-B.2; M_g).

Each cell holds the log-odds of being occupied. A return adds to its cell and every cell that its
ray passed loses: fog and strays that later rays pass through vanish. Returns of a cloud that lie in
one cell came by nearly the same way: one of their rays is walked, and its cells lose as often as
there are returns. Where only the cells of rings will be asked for, only what rays pass of the
rings' tube is walked, and those cells end up the same.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from perception.grid_kernel import Tube, bundled, fuse, mark_rings
from perception.values import Float
from perception.voxel_hash import Int64

#: Of a cell's mark: the number of the cloud that last touched it, times this, and two flags.
NUMBER = 4
#: Log-odds are kept in thousandths: whole numbers lie in one place with a cell's mark.
UNIT = 1000.0


class GridMap:
    """A cube of cells round a place."""

    def __init__(self, centre_w: Float, *, half_m: float, resolution_m: float) -> None:
        """Start with every cell unknown (log-odds 0)."""
        side = 2 * math.ceil(half_m / resolution_m)
        self.resolution_m = resolution_m
        self._scale = 1.0 / resolution_m
        # Log-odds and mark of each cell.
        self._cells: NDArray[np.int32] = np.zeros((side, side, side, 2), np.int32)
        self._fused = 0
        self.restart(centre_w)

    def restart(self, centre_w: Float) -> None:
        """Forget everything, and stand round another place."""
        self.centre_w = np.array(centre_w, np.float64)
        self._corner_w = self.centre_w - 0.5 * len(self._cells) * self.resolution_m
        self._fused += 1
        self._oldest = NUMBER * self._fused
        self._hit: list[Int64] = [np.empty(0, np.int64)]

    def fuse(self, points_w: Float, origins_w: Float, tube: Tube | None = None) -> None:
        """Fuse returns (N, 3) measured from (N, 3) or (3,), world metres; in a ``tube`` only."""
        points = np.ascontiguousarray(points_w, np.float64)
        origins = np.ascontiguousarray(np.atleast_2d(origins_w), np.float64)
        self._fused += 1
        scale = self._scale
        shape = np.zeros(9)
        if tube is not None:
            shape[:3] = (tube.start_w - self._corner_w) * scale
            shape[3:6] = tube.axis_w
            shape[6:] = np.array([tube.length_m, tube.radius_m, tube.margin_m]) * scale
        first, count = bundled(points, origins, self._corner_w, scale)
        marks = np.array([NUMBER * self._fused, self._oldest], np.int64)
        self._hit.append(
            fuse(points, origins, first, count, self._corner_w, scale, shape, self._cells, marks)
        )

    def log_odds(self, points_w: Float) -> Float:
        """Return the log-odds at points (..., 3); 0 where nothing is known, outside too."""
        cell = np.floor((points_w - self._corner_w) * self._scale).astype(np.int64)
        fits = np.logical_and(cell >= 0, cell < len(self._cells))
        inside = np.asarray(fits.all(axis=-1), np.bool_)
        safe = np.where(inside[..., None], cell, 0)
        here = self._cells[safe[..., 0], safe[..., 1], safe[..., 2]]
        known = inside & (here[..., 1] >= self._oldest)
        return np.asarray(np.where(known, here[..., 0], 0) / UNIT, np.float64)

    def occupied(self, points_w: Float) -> NDArray[np.bool_]:
        """Return for points (..., 3) whether their cell is occupied (outside the box: no)."""
        return np.asarray(self.log_odds(points_w) > 0.0, np.bool_)

    def occupied_on_rings(
        self, centres_w: Float, normal_w: Float, ring: Float
    ) -> NDArray[np.bool_]:
        """Return (N, M) whether the cell at each of (N, 3) centres plus (M, 3) ``ring`` is.

        The centres stand in even steps along the unit normal (3,), the ring's places in even steps
        round it (`ring_search`).
        """
        if len(self._hit) > 1:
            self._hit = [np.concatenate(self._hit)]
        radius = float(np.linalg.norm(ring[0]))
        right = ring[0] / radius
        up = ring[1] - (ring[1] @ right) * right
        frame = np.stack([normal_w, right, up / np.linalg.norm(up)])
        turn = math.acos(float(np.clip(ring[1] @ right / radius, -1.0, 1.0)))
        step = float((centres_w[1] - centres_w[0]) @ normal_w) if len(centres_w) > 1 else 1.0
        scale = self._scale
        out = np.zeros((len(centres_w), len(ring)), np.bool_)
        mark_rings(
            (centres_w - self._corner_w) * scale, ring * scale, frame,
            np.array([step * scale, radius * scale, turn]), self._hit[0], self._cells, out,
        )  # fmt: skip
        return out

    def cell_centres(self, points_w: Float) -> Float:
        """Return the centres (K, 3) of the distinct cells that hold points (N, 3)."""
        points = np.ascontiguousarray(points_w, np.float64)
        first, _ = bundled(points, np.zeros((1, 3)), self._corner_w, self._scale)
        cell = np.floor((points[first] - self._corner_w) * self._scale)
        return np.asarray(self._corner_w + (cell + 0.5) * self.resolution_m, np.float64)
