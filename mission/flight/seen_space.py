"""Where the LiDAR has looked in this flight: what it never saw is not taken for free.

The sensor sees a band of elevations about its own axis and nothing straight up or down. A cell of
space counts as seen once it has lain in that band for several scans (the sensor fills the band in
some tenths of a second), or was flown through. Obstacles before it are not looked at: what stands
in front keeps the vehicle farther away than what it hides. World ENU, metres.
"""

from __future__ import annotations

import math

import numpy as np

from config.sensors import Lidar
from perception.geometry import lidar_in_body, rotation_from_quaternion
from perception.values import Float

CELL_M = 2.0
REACH_M = 24.0
#: Looks (five a second) after which a cell has been seen.
LOOKS = 4
#: At its edges the sensor's band is thin.
EDGE_DEG = 1.0
FLOWN_M = 2.0
_HALF_CELLS = np.array([96, 96, 96])


def _ball() -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    reach = math.ceil(REACH_M / CELL_M)
    axis = np.arange(-reach, reach + 1)
    cells = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    near: np.ndarray[tuple[int, ...], np.dtype[np.int64]] = cells[
        np.linalg.norm(cells, axis=1) <= reach
    ].astype(np.int64)
    return near


_BALL = _ball()


class SeenSpace:
    """Cells round the vehicle, with how often each was looked at; what is far behind is dropped."""

    def __init__(self, lidar: Lidar) -> None:
        self._mount = lidar_in_body(lidar.nose_down_deg)
        self._low_rad = math.radians(lidar.min_elevation_deg + EDGE_DEG)
        self._high_rad = math.radians(lidar.max_elevation_deg - EDGE_DEG)
        self._looks = np.zeros(tuple(2 * _HALF_CELLS), np.uint8)
        self._origin_w: Float | None = None

    def look(self, position_w: Float, quaternion_wb: tuple[float, float, float, float]) -> None:
        """Note what a scan from here covers. ``quaternion_wb``: w x y z, body FLU into world."""
        if self._origin_w is None:
            self._origin_w = np.floor(position_w / CELL_M)
        here = np.floor(position_w / CELL_M).astype(np.int64)
        self._keep_round(here)
        cells = here + _BALL
        offset = (cells + 0.5) * CELL_M - position_w
        range_m = np.maximum(np.sqrt(np.einsum("nk,nk->n", offset, offset)), 1e-6)
        up = (rotation_from_quaternion(np.array(quaternion_wb)) @ self._mount)[:, 2]
        elevation = np.arcsin(np.clip(offset @ up / range_m, -1.0, 1.0))
        seen = (elevation > self._low_rad) & (elevation < self._high_rad)
        self._add(cells[seen], 1)
        self._add(cells[range_m < FLOWN_M], LOOKS)

    def _keep_round(self, here: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> None:
        """Move the cells along when the vehicle comes half-way to their border."""
        if self._origin_w is None:
            return
        shift = here - self._origin_w.astype(np.int64)
        if (np.abs(shift) <= _HALF_CELLS // 2).all():
            return
        moved = np.zeros_like(self._looks)
        if (np.abs(shift) < 2 * _HALF_CELLS).all():
            size = moved.shape
            to = tuple(slice(max(-s, 0), n - max(s, 0)) for s, n in zip(shift, size, strict=True))
            by = tuple(slice(max(s, 0), n - max(-s, 0)) for s, n in zip(shift, size, strict=True))
            moved[to] = self._looks[by]
        self._looks, self._origin_w = moved, self._origin_w + shift

    def seen(self, places_w: Float) -> bool:
        """Return whether all of the places (N, 3) have been seen."""
        if self._origin_w is None:
            return False
        cells = np.floor(np.atleast_2d(places_w) / CELL_M).astype(np.int64)
        index = cells - self._origin_w.astype(np.int64) + _HALF_CELLS
        if (index < 0).any() or (index >= 2 * _HALF_CELLS).any():
            return False
        return bool((self._looks[index[:, 0], index[:, 1], index[:, 2]] >= LOOKS).all())

    def _add(self, cells: np.ndarray[tuple[int, ...], np.dtype[np.int64]], looks: int) -> None:
        if self._origin_w is None:
            return
        index = cells - self._origin_w.astype(np.int64) + _HALF_CELLS
        inside = ((index >= 0) & (index < 2 * _HALF_CELLS)).all(axis=1)
        x, y, z = index[inside].T
        self._looks[x, y, z] = np.minimum(self._looks[x, y, z].astype(np.int64) + looks, 255)
