"""Rings searched for blades (Shi et al. 2025, Sec. III-B.2, Eq. 1 and 2), all at once."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from perception.grid_map import GridMap
from perception.values import Float


def search_points(start_w: Float, normal_w: Float, step_m: float, count: int) -> Float:
    """Return Q_s (Eq. 1): ``count`` points (N, 3) from the start along the normal.

    ``start_w``: (3,); ``normal_w``: (3,) unit v_n; ``step_m``: Delta d; ``count``: N.
    """
    return np.asarray(start_w + np.arange(1, count + 1)[:, None] * step_m * normal_w, np.float64)


def ring_offsets(normal_w: Float, radius_m: float, step_m: float) -> Float:
    """Return the ring of Eq. 2 about the origin: (M, 3).

    Points lie at ``radius_m`` (r_s) in the plane of ``normal_w``, neighbours ``step_m`` (Delta l)
    apart, but for the last and the first, which are nearer.
    """
    turn = 2 * math.asin(min(step_m / (2 * radius_m), 1.0))
    angles = np.arange(0.0, 2 * math.pi, turn)
    helper = np.array([0.0, 0.0, 1.0]) if abs(normal_w[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    across = np.cross(normal_w, helper)
    across /= np.linalg.norm(across)
    up = np.cross(across, normal_w)
    ring = np.cos(angles)[:, None] * across + np.sin(angles)[:, None] * up
    return np.asarray(radius_m * ring, np.float64)


def search_rings(
    grid: GridMap, centres_w: Float, normal_w: Float, radius_m: float, step_m: float
) -> tuple[Float, NDArray[np.bool_]]:
    """Return the ring (M, 3) about the origin, and which of its points are occupied (N, M).

    ``centres_w``: (N, 3), Q_s; a point is occupied where it falls into an occupied cell.
    """
    ring = ring_offsets(normal_w, radius_m, step_m)
    return ring, grid.occupied_on_rings(centres_w, normal_w, ring)
