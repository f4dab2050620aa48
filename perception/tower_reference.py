"""Straight down by the tower's axis, as seen behind the rotor, gated by gravity.

A cone is fitted to the points below the hub and behind the rotor plane; its axis is blended with
gravity by their variances, since a short or half-hidden piece of tower can be 3-10 deg off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.turbine import Turbine
from perception.rotor import right_in_plane
from perception.values import Float
from perception.voxel_hash import compiled

MIN_POINTS = 25
MIN_LENGTH_M = 3.0
GRAVITY_SIGMA_RAD = math.radians(0.6)
"""How far the tower may stand from gravity as told: lean 0.25-0.5 deg, attitude 0.5 deg."""
ACROSS_SIGMA_M = 0.04
ALONG_SIGMA_M = 0.15
"""Of a point across the line of sight, and along it: ranges err together, by incidence and time,
so that the tower's outline says where its axis is and its face hardly does."""
SYSTEMATIC_M = 0.008
"""Of one end of the axis against the other: bands, ladders, taper that is not linear."""
SHAFT_SIGMA_M = 0.08
"""How near the tower's axis passes the shaft; the hub's own error is part of it."""
FORMAL_FACTOR = 0.65
"""Error over formal error on scenes: outline points err less than their sigma, and not alike."""
GATE = 6.0
"""Sigmas of gravity that a tower may stand off it and still be one."""
ITERATIONS = 12
SKIN_M = 0.4
"""What lies so near the tower's surface is the tower: ranges err, and so does the cone."""
#: Of x0, lean x, y0, lean y, radius and taper: near vertical, size and taper of real towers.
PRIOR_MEAN = np.array([0.0, 0.0, 0.0, 0.0, 1.6, 0.01])
PRIOR_SIGMA = np.array([3e4, 0.05, 3e4, 0.02, 0.6, 0.006])
KNOWN_SIGMA = (0.05, 0.003)
"""Of radius and taper, where the type of turbine says them."""


@dataclass(frozen=True, slots=True, eq=False)
class TowerReference:
    """The tower's axis pointing down, and what it is worth."""

    down_w: Float
    """(3,) unit"""
    sigma_rad: float
    """Of the axis across the line of sight."""
    length_m: float
    points: int
    axes: Float
    """(3, 3) unit rows: to the right, back, down."""
    cone: Float
    """(6,) x0, lean x, y0, lean y, radius, taper: of the axis below the hub, along the rows."""


def tower_reference(
    points_w: Float,
    hub_w: Float,
    normal_w: Float,
    down_w: Float,
    radius_m: float,
    turbine: Turbine | None = None,
) -> TowerReference | None:
    """Return the tower's direction, or None where too little of it is seen.

    ``points_w``: (N, 3) world metres; ``hub_w``, ``normal_w`` (downwind), ``down_w``: (3,);
    ``radius_m`` sets the region: 2.5-20 % of it behind the rotor. ``turbine``: how thick its tower
    is, without which a tower half hidden by a blade leaves its axis open.
    """
    back = normal_w - (normal_w @ down_w) * down_w
    back = back / np.linalg.norm(back)
    axes = np.stack([right_in_plane(back, down_w), back, down_w])
    points = np.ascontiguousarray(points_w)
    local = np.empty_like(points)
    local = local[: _behind(points, np.array(hub_w, np.float64), axes, radius_m, local)]
    if len(local) < MIN_POINTS:
        return None
    size = 0.024 * radius_m + 0.3
    # The nearest surface says where the axis is; it stands under the shaft.
    near = np.partition(local[:, 1], len(local) // 10)[len(local) // 10]
    params = np.array([0.0, 0.0, near + size, 0.0, size, 0.01])
    sink = float(normal_w @ down_w) / math.hypot(*(normal_w - (normal_w @ down_w) * down_w))
    covariance, kept = np.zeros((6, 6)), np.zeros(len(local), np.bool_)
    mean, sigmas = _prior(turbine)
    if not _settle(local, params, sink, mean, 1 / sigmas**2, covariance, kept):
        return None
    depth = local[kept, 2]
    length = float(np.ptp(np.quantile(depth, [0.02, 0.98])))
    if length < MIN_LENGTH_M or not 0.2 < params[4] < 5.0:
        return None
    lean_x = float(params[1])
    sigma = math.hypot(math.sqrt(covariance[1, 1]) * FORMAL_FACTOR, SYSTEMATIC_M / length)
    weight = GRAVITY_SIGMA_RAD**2 / (GRAVITY_SIGMA_RAD**2 + sigma**2)
    if abs(lean_x) > GATE * math.hypot(GRAVITY_SIGMA_RAD, sigma):
        return None
    direction = down_w + weight * lean_x * axes[0]
    direction = direction / np.linalg.norm(direction)
    blended = math.sqrt(weight) * sigma
    return TowerReference(direction, blended, length, int(kept.sum()), axes, params)


def without_tower(points_w: Float, hub_w: Float, tower: TowerReference) -> Float:
    """Return the points (M, 3) that are not on or in the tower, as it stands below ``hub_w``."""
    points = np.ascontiguousarray(points_w)
    kept = np.empty_like(points)
    return kept[: _off_cone(points, hub_w, tower.axes, tower.cone, kept)]


@compiled
def _off_cone(points: Float, hub: Float, axes: Float, cone: Float, out: Float) -> int:
    """Write the points (N, 3) that are not within a little of the cone; return how many."""
    used = 0
    for n in range(len(points)):
        a, b, c = points[n, 0] - hub[0], points[n, 1] - hub[1], points[n, 2] - hub[2]
        z = a * axes[2, 0] + b * axes[2, 1] + c * axes[2, 2]
        if z > 0.0:
            x = a * axes[0, 0] + b * axes[0, 1] + c * axes[0, 2] - cone[0] - cone[1] * z
            y = a * axes[1, 0] + b * axes[1, 1] + c * axes[1, 2] - cone[2] - cone[3] * z
            reach = cone[4] + cone[5] * z + SKIN_M
            if x * x + y * y < reach * reach:
                continue
        out[used, 0], out[used, 1], out[used, 2] = points[n, 0], points[n, 1], points[n, 2]
        used += 1
    return used


def _prior(turbine: Turbine | None) -> tuple[Float, Float]:
    """Return mean and sigma (6,) of x0, lean x, y0, lean y, radius at the hub's height, taper."""
    mean, sigma = PRIOR_MEAN.copy(), PRIOR_SIGMA.copy()
    if turbine is not None:
        top, base = turbine.tower_top_diameter_m / 2, turbine.tower_base_diameter_m / 2
        taper = (base - top) / turbine.tower_height_m
        mean[4:] = top - taper * (turbine.hub_height_m - turbine.tower_height_m), taper
        sigma[4:] = KNOWN_SIGMA
    return mean, sigma


@compiled
def _behind(points: Float, hub: Float, axes: Float, radius: float, out: Float) -> int:
    """Write right, back, down of the points that may be the tower; return how many."""
    wide = 0.075 * radius + 0.8
    used = 0
    for n in range(len(points)):
        a, b, c = points[n, 0] - hub[0], points[n, 1] - hub[1], points[n, 2] - hub[2]
        y = a * axes[1, 0] + b * axes[1, 1] + c * axes[1, 2]
        if not 0.028 * radius + 0.3 < y < 0.20 * radius:
            continue
        x = a * axes[0, 0] + b * axes[0, 1] + c * axes[0, 2]
        z = a * axes[2, 0] + b * axes[2, 1] + c * axes[2, 2]
        if abs(x) < wide and 0.085 * radius < z < 45.0:
            out[used, 0], out[used, 1], out[used, 2] = x, y, z
            used += 1
    return used


@compiled
def _settle(
    local: Float, params: Float, sink: float, mean: Float, info: Float, covariance: Float,
    kept: NDArray[np.bool_],
) -> bool:  # fmt: skip
    """Fit x0, lean x, y0, lean y, radius, taper in place; False where too few points are kept.

    ``local``: (N, 3) right, back, down of the hub; ``sink``: how far the shaft falls a metre
    towards the tower. Robust Gauss-Newton with a gate that narrows.
    """
    row = np.zeros(6)
    for iteration in range(ITERATIONS):
        gate = (
            np.inf if iteration == 0 else 0.5 if iteration < 5 else 0.2 if iteration < 8 else 0.12
        )
        system, pull, count = np.zeros((6, 6)), np.zeros(6), 0
        for n in range(len(local)):
            x, y, z = local[n, 0], local[n, 1], local[n, 2]
            across, along = x - params[0] - params[1] * z, y - params[2] - params[3] * z
            distance = max(math.sqrt(across * across + along * along), 1e-6)
            error = distance - params[4] - params[5] * z
            kept[n] = abs(error) < gate
            if not kept[n]:
                continue
            count += 1
            variance = (across * ACROSS_SIGMA_M) ** 2 + (along * ALONG_SIGMA_M) ** 2
            sigma = math.sqrt(variance) / distance
            weight = 1.0 / max(1.0, abs(error) / (1.5 * sigma)) / sigma**2
            row[0], row[2], row[4], row[5] = -across / distance, -along / distance, -1.0, -z
            row[1], row[3] = row[0] * z, row[2] * z
            for a in range(6):
                pull[a] -= weight * row[a] * error
                for b in range(6):
                    system[a, b] += weight * row[a] * row[b]
        if count < MIN_POINTS:
            return False
        for a in range(6):
            system[a, a] += info[a]
            pull[a] += info[a] * (mean[a] - params[a])
        # The axis meets the shaft.
        under = params[2] * sink
        off = params[0] + params[1] * under
        row[:] = 0.0
        row[0], row[1] = 1.0, under
        for a in range(2):
            pull[a] -= row[a] * off / SHAFT_SIGMA_M**2
            for b in range(2):
                system[a, b] += row[a] * row[b] / SHAFT_SIGMA_M**2
        step = np.linalg.solve(system, pull)
        for a in range(6):
            params[a] += min(max(step[a], -0.5), 0.5)
        covariance[:] = np.linalg.inv(system)
    return True
