"""Tower axis, radius and top from scans taken on the way up.

The tower is the one thing near its expected place that stands upright for tens of metres: a cone,
nearly vertical. Cells of the ground plan that are hit at many heights propose it, a vote over
centre and radius picks it from trees, blades and neighbours, and a robust fit gives axis and taper.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from config.turbine import Turbine
from perception.values import Float
from perception.voxel_hash import compiled

#: Heights are judged in rings of this size.
RING_M = 2.0
MIN_RINGS = 8
INLIER_M = 0.3
#: How far the centre can lie from a cell of the surface: the largest radius and the cell.
REACH_M = 6.0
MAX_LEAN = math.tan(math.radians(2.0))
#: Points that vote on the centre; the refinement uses all.
VOTERS = 300
#: Something must be seen this far above the last ring, or the view ended rather than the tower.
ABOVE_M = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Tower:
    """A tower as fitted: an axis with a radius that falls linearly with height."""

    foot_w: Float
    """(3,) the axis at the lowest ring seen."""
    axis_w: Float
    """(3,) unit, upward."""
    radius_m: float
    """At `foot_w`."""
    taper: float
    """Change of radius per metre of height (negative: thinner upward)."""
    top_m: float | None
    """Height (z) of the top, None until something was seen above it."""
    highest_m: float
    """Height (z) of the highest ring seen."""
    sigma_m: float
    """Of the axis, horizontally, at mid-height of what was seen."""
    points: int

    def at_height(self, z_m: float) -> Float:
        """Return the point of the axis at a height (3,)."""
        along = (z_m - self.foot_w[2]) / self.axis_w[2]
        return np.asarray(self.foot_w + along * self.axis_w, np.float64)

    def surface_distance(self, points_w: Float) -> Float:
        """Return the horizontal distance of points (N, 3) from the cone, positive outside."""
        height = points_w[:, 2] - self.foot_w[2]
        lean = self.axis_w[:2] / self.axis_w[2]
        offset = points_w[:, :2] - self.foot_w[:2] - height[:, None] * lean
        radius = np.maximum(self.radius_m + self.taper * height, 0.2)
        return np.asarray(np.hypot(offset[:, 0], offset[:, 1]) - radius, np.float64)


def fit_tower(
    points_w: Float,
    *,
    expected_xy: Float,
    turbine: Turbine | None = None,
    search_m: float = 18.0,
) -> Tower | None:
    """Return the tower near its expected place, None where nothing stands there upright.

    ``points_w``: (N, 3) world metres, voxel-thinned; ``expected_xy``: (2,), up to ``search_m``
    wrong; ``turbine``: gives the radius by height where the type is known.
    """
    points = np.asarray(points_w, np.float64)
    near = np.linalg.norm(points[:, :2] - expected_xy, axis=1) < search_m + REACH_M
    points = points[near & np.isfinite(points).all(axis=1)]
    if len(points) < 30:
        return None
    best: tuple[int, Float, Float] | None = None
    for cell_xy in _upright_cells(points, expected_xy, search_m):
        around = points[np.linalg.norm(points[:, :2] - cell_xy, axis=1) < REACH_M + 1.0]
        start = _vote(around, cell_xy, turbine)
        cone = _refine(around, start, turbine)
        inlier = np.abs(_residual(around, cone)) < INLIER_M
        count = int(inlier.sum())
        # A tower is a clean skin; foliage and lattices fill the space about it.
        clean = count > 0.5 * int((np.abs(_residual(around, cone)) < 1.0).sum())
        plausible = clean and _plausible(cone, around[inlier, 2])
        if plausible and (best is None or count > best[0]):
            best = (count, cone, around)
    if best is None:
        return None
    return _tower(best[1], best[2], points)


def _upright_cells(points: Float, expected_xy: Float, search_m: float) -> Float:
    """Return centres (K, 2) of the 1 m cells that are hit at the most heights, best first."""
    i, j = np.floor(points[:, 0]).astype(np.int64), np.floor(points[:, 1]).astype(np.int64)
    i0, j0 = i.min(), j.min()
    rings = np.unique(np.stack([i - i0, j - j0, np.floor(points[:, 2] / RING_M)]), axis=1)
    plan = np.zeros((int(i.max() - i0) + 1, int(j.max() - j0) + 1))
    np.add.at(plan, (rings[0].astype(np.int64), rings[1].astype(np.int64)), 1.0)
    cells: list[Float] = []
    for _ in range(4):
        a, b = np.unravel_index(int(np.argmax(plan)), plan.shape)
        if plan[a, b] < 3:
            break
        centre = np.array([a + i0 + 0.5, b + j0 + 0.5])
        if np.linalg.norm(centre - expected_xy) < search_m + 4.0:
            cells.append(centre)
        plan[max(a - 2, 0) : a + 3, max(b - 2, 0) : b + 3] = 0
    return np.array(cells).reshape(-1, 2)


def _vote(points: Float, cell_xy: Float, turbine: Turbine | None) -> Float:
    """Return the best cone of a grid: x, y, lean x, lean y, radius, taper, at mid-height."""
    middle = _middle(points)
    height = points[:, 2] - middle
    if turbine is None:
        radii, taper = np.array([0.7, 1.0, 1.4, 1.8, 2.3, 2.9, 3.6, 4.5]), -0.012
    else:
        base, top = turbine.tower_base_diameter_m / 2, turbine.tower_top_diameter_m / 2
        taper = (top - base) / turbine.tower_height_m
        low = points[:, 2].min()
        typical = float(np.clip(base + taper * (middle - low), top, base))
        radii = typical * np.array([0.85, 1.0, 1.15])
    steps = np.arange(-REACH_M, REACH_M + 0.01, 0.5)
    some = np.linspace(0, len(points) - 1, min(len(points), VOTERS)).astype(np.int64)
    x, y, radius = _best_circle(points[some, :2] - cell_xy, height[some], steps, radii, taper)
    return np.array([x + cell_xy[0], y + cell_xy[1], 0.0, 0.0, radius, taper])


@compiled
def _best_circle(
    xy: Float, height: Float, steps: Float, radii: Float, taper: float
) -> tuple[float, float, float]:
    best, best_x, best_y, best_r = -1e9, 0.0, 0.0, radii[0]
    for cx in steps:
        for cy in steps:
            for radius in radii:
                score = 0.0
                for n in range(len(xy)):
                    r = radius + taper * height[n]
                    d = np.hypot(xy[n, 0] - cx, xy[n, 1] - cy) - r
                    if abs(d) < 0.5:
                        score += 1.0 - 2.0 * abs(d)
                    elif d < 0:
                        # Nothing is measured inside a tower.
                        score -= 0.5
                if score > best:
                    best, best_x, best_y, best_r = score, cx, cy, radius
    return best_x, best_y, best_r


def _middle(points: Float) -> float:
    return float(np.median(points[:, 2]))


def _residual(points: Float, cone: Float) -> Float:
    height = points[:, 2] - _middle(points)
    x = points[:, 0] - cone[0] - cone[2] * height
    y = points[:, 1] - cone[1] - cone[3] * height
    return np.asarray(np.hypot(x, y) - cone[4] - cone[5] * height, np.float64)


def _refine(points: Float, start: Float, turbine: Turbine | None) -> Float:
    """Return the cone after robust Gauss-Newton steps (Tukey weights, narrowing)."""
    cone = start.copy()
    height = points[:, 2] - _middle(points)
    # Towers are plumb to a few mrad and taper gently; the type's radius is a fair prior.
    radius_sigma = 0.3 * start[4] if turbine is None else 0.1 * start[4]
    prior_sigma = np.array([1e3, 1e3, 0.004, 0.004, radius_sigma, 0.008])
    for width_m in (1.0, 0.8, 0.6, 0.5, 0.4, 0.4, 0.4):
        x = points[:, 0] - cone[0] - cone[2] * height
        y = points[:, 1] - cone[1] - cone[3] * height
        reach = np.maximum(np.hypot(x, y), 1e-6)
        residual = reach - cone[4] - cone[5] * height
        weight = np.clip(1 - (residual / width_m) ** 2, 0, None) ** 2 / 0.1**2
        ux, uy = x / reach, y / reach
        rows = np.stack([-ux, -uy, -ux * height, -uy * height, -np.ones_like(ux), -height], axis=1)
        normal = rows.T @ (rows * weight[:, None]) + np.diag(prior_sigma**-2)
        target = np.array([0, 0, 0, 0, start[4], start[5]])
        pull = (target - cone) / prior_sigma**2
        pull[:2] = 0.0
        step = np.linalg.solve(normal, -(rows.T @ (weight * residual)) + pull)
        cone = cone + step.clip(-2.0, 2.0)
    return cone


def _rings(heights_m: Float) -> int:
    """Return how many rings of 2 m hold at least two of the heights."""
    _, counts = np.unique(np.floor(heights_m / RING_M), return_counts=True)
    return int((counts >= 2).sum())


def _plausible(cone: Float, heights_m: Float) -> bool:
    if len(heights_m) < 25 or not 0.4 < cone[4] < REACH_M or _rings(heights_m) < MIN_RINGS:
        return False
    rings = np.unique(np.floor(heights_m / RING_M))
    filled = len(rings) / (rings[-1] - rings[0] + 1)
    return bool(math.hypot(cone[2], cone[3]) < MAX_LEAN and filled > 0.5)


def _tower(cone: Float, around: Float, points: Float) -> Tower:
    residual = _residual(around, cone)
    heights = np.sort(around[np.abs(residual) < INLIER_M, 2])
    low, high = _longest_run(heights)
    high = _below_nacelle(around[:, 2], residual, low, high)
    middle = _middle(around)
    foot = np.array([*(cone[:2] + cone[2:4] * (low - middle)), low])
    axis = np.array([cone[2], cone[3], 1.0])
    from_axis = np.linalg.norm(points[:, :2] - (cone[:2] + cone[2:4] * (high - middle)), axis=1)
    above = (points[:, 2] > high + ABOVE_M) & (from_axis < 12.0)
    inliers = np.abs(residual) < INLIER_M
    spread = float(np.sqrt(np.mean(residual[inliers] ** 2)))
    return Tower(
        foot_w=foot,
        axis_w=axis / np.linalg.norm(axis),
        radius_m=float(cone[4] + cone[5] * (low - middle)),
        taper=float(cone[5]),
        top_m=high if int(above.sum()) >= 8 else None,
        highest_m=high,
        # One side only is seen: the radius' uncertainty is the axis', along the view.
        sigma_m=0.05 + 0.05 * float(cone[4]) + 4 * spread / math.sqrt(int(inliers.sum())),
        points=int(inliers.sum()),
    )


def _below_nacelle(heights_m: Float, residual: Float, low: float, high: float) -> float:
    """Return the height down from ``high`` to where rings hold the tower's skin for the most part.

    Sides of a narrow nacelle, or a blade pointing up, lie within the tolerance of the cone here and
    there, but most of their returns stand off it.
    """
    close = residual < 1.5
    for top in np.arange(high, low + RING_M, -0.5):
        ring = close & (heights_m > top - RING_M) & (heights_m <= top)
        skin = ring & (np.abs(residual) < INLIER_M)
        topmost = skin & (heights_m > top - 0.5)
        if topmost.any() and int(skin.sum()) >= 3 and int(skin.sum()) > 0.7 * int(ring.sum()):
            return float(heights_m[topmost].max())
    return low


def _longest_run(heights_m: Float) -> tuple[float, float]:
    """Return the ends of the longest stretch of sorted heights without a gap of 4 m."""
    breaks = np.flatnonzero(np.diff(heights_m) > 2 * RING_M)
    starts = np.concatenate([[0], breaks + 1])
    ends = np.concatenate([breaks, [len(heights_m) - 1]])
    longest = int(np.argmax(heights_m[ends] - heights_m[starts]))
    return float(heights_m[starts[longest]]), float(heights_m[ends[longest]])
