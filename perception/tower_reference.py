"""Straight down by the tower's axis, as seen behind the rotor, gated by gravity.

A cone is fitted to the points below the hub and behind the rotor plane; its axis is blended with
gravity by their variances, since a short or half-hidden piece of tower can be 3-10 deg off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.rotor import right_in_plane
from perception.values import Float

MIN_POINTS = 25
MIN_LENGTH_M = 3.0
GRAVITY_SIGMA_RAD = math.radians(0.6)
"""How far the tower may stand from gravity as told: lean 0.25-0.5 deg, attitude 0.5 deg."""
POINT_SIGMA_M = 0.03
SYSTEMATIC_M = 0.008
"""Of one end of the axis against the other: bands, ladders, taper that is not linear."""


@dataclass(frozen=True, slots=True, eq=False)
class TowerReference:
    """The tower's axis pointing down, and what it is worth."""

    down_w: Float
    """(3,) unit"""
    sigma_rad: float
    """Of the axis across the line of sight."""
    length_m: float
    points: int


def tower_reference(
    points_w: Float, hub_w: Float, normal_w: Float, down_w: Float, radius_m: float
) -> TowerReference | None:
    """Return the tower's direction, or None where too little of it is seen.

    ``points_w``: (N, 3) world metres; ``hub_w``, ``normal_w`` (downwind), ``down_w``: (3,);
    ``radius_m`` sets the region: 2.5-20 % of it behind the rotor.
    """
    back = normal_w - (normal_w @ down_w) * down_w
    back = back / np.linalg.norm(back)
    right = right_in_plane(back, down_w)
    rel = points_w - hub_w
    x, y, z = rel @ right, rel @ back, rel @ down_w
    wide = 0.075 * radius_m + 0.8
    keep = (np.abs(x) < wide) & (y > 0.028 * radius_m + 0.3) & (y < 0.20 * radius_m)
    keep &= (z > 0.085 * radius_m) & (z < 45.0)
    x, y, z = x[keep], y[keep], z[keep]
    if len(x) < MIN_POINTS:
        return None
    sel: NDArray[np.bool_] = np.ones(len(x), bool)
    params = _start(x, y, radius_m)
    covariance = np.eye(6)
    for iteration in range(12):
        if sel.sum() < MIN_POINTS:
            return None
        params, covariance = _step(params, x[sel], y[sel], z[sel])
        error = _residual(params, x, y, z)[0]
        sel = np.abs(error) < (0.5 if iteration < 4 else 0.2 if iteration < 7 else 0.12)
    length = float(np.ptp(np.quantile(z[sel], [0.02, 0.98])))
    if length < MIN_LENGTH_M or not 0.2 < params[4] < 5.0:
        return None
    lean_x = params[1]
    sigma = math.hypot(math.sqrt(covariance[1, 1]) * 1.2, SYSTEMATIC_M / length)
    weight = GRAVITY_SIGMA_RAD**2 / (GRAVITY_SIGMA_RAD**2 + sigma**2)
    if abs(lean_x) > 4 * math.hypot(GRAVITY_SIGMA_RAD, sigma):
        return None
    direction = down_w + weight * lean_x * right
    direction = direction / np.linalg.norm(direction)
    blended = math.sqrt(weight) * sigma
    return TowerReference(direction, blended, length, int(sel.sum()))


def _start(x: Float, y: Float, radius_m: float) -> Float:
    """Return x0, lean x, y0, lean y, radius, taper: the nearest surface says where the axis is."""
    size = 0.024 * radius_m + 0.3
    return np.array([np.median(x), 0.0, float(np.quantile(y, 0.1)) + size, 0.0, size, 0.01])


def _residual(params: Float, x: Float, y: Float, z: Float) -> tuple[Float, Float, Float, Float]:
    across, along = x - params[0] - params[1] * z, y - params[2] - params[3] * z
    distance = np.maximum(np.hypot(across, along), 1e-6)
    return distance - params[4] - params[5] * z, across, along, distance


def _step(params: Float, x: Float, y: Float, z: Float) -> tuple[Float, Float]:
    error, across, along, distance = _residual(params, x, y, z)
    jac = np.stack(
        [
            -across / distance,
            -across / distance * z,
            -along / distance,
            -along / distance * z,
            -np.ones_like(z),
            -z,
        ],
        axis=1,
    )
    weight = 1.0 / np.maximum(1.0, np.abs(error) / (1.5 * POINT_SIGMA_M)) / POINT_SIGMA_M**2
    info = (jac * weight[:, None]).T @ jac
    # Priors: near vertical, taper of real towers.
    prior = np.array([0, 1 / 0.05**2, 0, 1 / 0.02**2, 1 / 0.6**2, 1 / 0.006**2])
    pull = prior * (np.array([0, 0, 0, 0, params[4], 0.01]) - params)
    system = info + np.diag(prior + 1e-9)
    step = np.linalg.solve(system, -(jac * weight[:, None]).T @ error + pull)
    return params + np.clip(step, -0.5, 0.5), np.asarray(np.linalg.inv(system), np.float64)
