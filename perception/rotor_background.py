"""What stands behind a rotor and is too wide for one: slopes, walls, woods, told by width.

Blades and tower are a few metres wide; in every square of `WINDOW_M` of a plane through them most
of the square is open. A hillside within the LiDAR's range fills it, holds more points than the
rotor, and fills three arms of any direction better than three blades do. It is taken out where the
cloud as it is was refused, or where its best plane is such a surface.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.coarse_rotor import rotor_planes
from perception.rotor import down_in_plane, right_in_plane
from perception.values import Float
from perception.voxel_hash import compiled

CELL_M = 1.0
WINDOW_M = 21
FILLED = 0.7
"""Of a square: three blades 6 m wide at their roots, and a tower, fill 55 %."""
SLAB_M = 3.0
"""Of a plane, to either side: a hillside is not flat."""
WIDE_SHARE = 0.5
"""Of the points near a plane: where more of them are of something wide, it is not the rotor's."""
MOST_PLANES = 8


def without_background(
    points_w: Float, viewpoint_w: Float, prior_normal_w: Float | None, down_w: Float
) -> Float:
    """Return the points (M, 3) of a cloud (N, 3) that are of nothing wide and upright.

    ``viewpoint_w``, ``down_w``: (3,); ``prior_normal_w``: (3,) downwind or None.
    """
    for _ in range(MOST_PLANES):
        before = len(points_w)
        for plane in rotor_planes(points_w, viewpoint_w, prior_normal_w, down_w):
            points_w = _without_wide(points_w, plane, down_w)
        if len(points_w) == before:
            break
    return points_w


def is_background(points_w: Float, plane: tuple[Float, float], down_w: Float) -> bool:
    """Return whether a plane (unit normal (3,), offset) lies in something too wide for a rotor.

    ``points_w``: (N, 3); ``down_w``: (3,).
    """
    slab = _slab(points_w, plane)
    if len(slab) < FILLED * (WINDOW_M / CELL_M) ** 2:
        return False
    held = points_w[slab]
    return len(held) - len(_without_wide(held, plane, down_w)) > WIDE_SHARE * len(held)


def _slab(points_w: Float, plane: tuple[Float, float]) -> NDArray[np.int64]:
    """Return the indices of the points near a plane."""
    normal, offset = plane
    return np.flatnonzero(np.abs(points_w @ normal - offset) < SLAB_M)


def _without_wide(points_w: Float, plane: tuple[Float, float], down_w: Float) -> Float:
    normal = plane[0]
    slab = _slab(points_w, plane)
    if len(slab) == 0:
        return points_w
    axes = np.stack([right_in_plane(normal, down_w), down_in_plane(normal, down_w)])
    local = points_w[slab] @ axes.T
    cells = np.floor((local - local.min(axis=0)) / CELL_M).astype(np.int64)
    occupied = np.zeros(cells.max(axis=0) + 1, np.bool_)
    occupied[cells[:, 0], cells[:, 1]] = True
    wide = _filled_squares(occupied, round(WINDOW_M / CELL_M))
    keep = np.ones(len(points_w), np.bool_)
    keep[slab] = ~wide[cells[:, 0], cells[:, 1]]
    return points_w[keep]


@compiled
def _filled_squares(occupied: NDArray[np.bool_], window: int) -> NDArray[np.bool_]:
    """Return which cells lie in a square of ``window`` cells that is filled."""
    wide = np.zeros_like(occupied)
    rows, columns = occupied.shape
    sums = np.zeros((rows + 1, columns + 1), np.int64)
    for i in range(rows):
        for j in range(columns):
            sums[i + 1, j + 1] = sums[i, j + 1] + sums[i + 1, j] - sums[i, j] + occupied[i, j]
    for i in range(rows - window + 1):
        for j in range(columns - window + 1):
            held = sums[i + window, j + window] - sums[i, j + window]
            held += sums[i, j] - sums[i + window, j]
            if held >= FILLED * window * window:
                wide[i : i + window, j : j + window] = True
    return wide
