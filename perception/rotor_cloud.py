"""Points that a rotor fit may use: finite, thinned, near the prior hub where there is one."""

from __future__ import annotations

import numpy as np

from perception.values import Float
from perception.voxel_hash import compiled

MAX_POINTS = 60_000
MIN_RANGE_M = 6.0
"""Nearer returns are clutter: the vehicle keeps further away than this."""
MAX_RANGE_M = 120.0
FARTHEST_M = 1e5
"""From the world's origin: what lies further is no measurement."""
ENOUGH_ORIGINS = 400


def usable_points(
    points_w: Float, origins_w: Float, viewpoint_w: Float | None
) -> tuple[Float, Float]:
    """Return finite, thinned points (M, 3) and the viewpoint (3,)."""
    points: Float = np.asarray(points_w, np.float64).reshape(-1, 3)
    origins = np.asarray(origins_w, np.float64)
    if origins.ndim == 2 and len(origins) != len(points):
        raise ValueError("origins_w must be (3,) or as long as points_w")
    if len(points) > MAX_POINTS:
        step = -(-len(points) // MAX_POINTS)
        points = points[::step]
        origins = origins[::step] if origins.ndim == 2 else origins
    if viewpoint_w is not None:
        eye = np.array(viewpoint_w, np.float64)
    else:
        eye = _middle(origins) if origins.ndim == 2 else np.array(origins)
    points = np.require(points, requirements=["C", "W"])  # one kind of array, one compiled kernel
    kept = np.empty_like(points)
    return kept[: _usable(points, eye, kept)], eye


def _middle(origins_w: Float) -> Float:
    """Return the median of origins (N, 3), by as many of them as tell it."""
    some = origins_w[:: max(1, len(origins_w) // ENOUGH_ORIGINS)]
    sane = some[np.isfinite(some).all(axis=1)]
    return np.asarray(np.median(sane, axis=0) if len(sane) else np.zeros(3), np.float64)


@compiled
def _usable(points: Float, eye: Float, out: Float) -> int:
    """Copy the points that are finite, not zero and in range; return how many."""
    used = 0
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        # Comparisons with NaN are false.
        if not (abs(x) < FARTHEST_M and abs(y) < FARTHEST_M and abs(z) < FARTHEST_M):
            continue
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        d_x, d_y, d_z = x - eye[0], y - eye[1], z - eye[2]
        range2 = d_x * d_x + d_y * d_y + d_z * d_z
        if MIN_RANGE_M * MIN_RANGE_M < range2 < MAX_RANGE_M * MAX_RANGE_M:
            out[used, 0], out[used, 1], out[used, 2] = x, y, z
            used += 1
    return used


def about_prior(
    points: Float, hub_w: Float, normal_w: Float | None, radius: float, prior_sigma_m: float
) -> Float:
    """Leave out what cannot be this rotor: hills, neighbours, the ground beneath."""
    axis = np.zeros(3) if normal_w is None else np.array(normal_w, np.float64)
    # A prior axis 10 deg wrong moves a blade's depth by a sixth of the radius seen.
    deep = prior_sigma_m + 0.2 * radius
    kept = np.empty_like(points)
    return kept[: _about(points, np.array(hub_w), axis, radius + prior_sigma_m, deep, kept)]


@compiled
def _about(points: Float, hub: Float, axis: Float, reach: float, deep: float, out: Float) -> int:
    """Copy the points within ``reach`` of the hub and ``deep`` along the axis; return how many."""
    used = 0
    for n in range(len(points)):
        x, y, z = points[n, 0] - hub[0], points[n, 1] - hub[1], points[n, 2] - hub[2]
        if x * x + y * y + z * z >= reach * reach:
            continue
        if abs(x * axis[0] + y * axis[1] + z * axis[2]) < deep:
            out[used] = points[n]
            used += 1
    return used
