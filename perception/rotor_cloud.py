"""Points that a rotor fit may use: finite, thinned, near the prior hub where there is one."""

from __future__ import annotations

import numpy as np

from perception.values import Float

MAX_POINTS = 60_000
MIN_RANGE_M = 6.0
"""Nearer returns are clutter: the vehicle keeps further away than this."""
MAX_RANGE_M = 120.0


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
    finite = np.isfinite(points).all(axis=1) & (np.abs(points) < 1e5).all(axis=1)
    finite &= (points != 0).any(axis=1)
    points = points[finite]
    if origins.ndim == 2:
        origins = origins[finite]
        sane = origins[np.isfinite(origins).all(axis=1)]
        middle = np.median(sane, axis=0) if len(sane) else np.zeros(3)
    else:
        middle = origins
    eye = middle if viewpoint_w is None else np.asarray(viewpoint_w, np.float64)
    ranges = np.linalg.norm(points - eye, axis=1)
    return points[(ranges > MIN_RANGE_M) & (ranges < MAX_RANGE_M)], eye


def about_prior(
    points: Float, hub_w: Float, normal_w: Float | None, radius: float, prior_sigma_m: float
) -> Float:
    """Leave out what cannot be this rotor: hills, neighbours, the ground beneath."""
    rel = points - hub_w
    keep = np.linalg.norm(rel, axis=1) < radius + prior_sigma_m
    if normal_w is not None:
        # A prior axis 10 deg wrong moves a blade's depth by a sixth of the radius seen.
        keep &= np.abs(rel @ normal_w) < prior_sigma_m + 0.2 * radius
    return np.asarray(points[keep], np.float64)
