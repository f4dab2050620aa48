"""Centre line of the blade in view and the foot of the perpendicular on it.

Shi et al. 2025, Sec. III-C: a line is fitted by RANSAC to the blade's points (l_P), and the
inspection point p_f is the foot of the perpendicular from the vehicle on it (Eq. 3). Three things
differ. The points are taken near the modelled axis and near the vehicle, so that tower, nacelle
and neighbour blades never join in. What is seen is the near skin, half a thickness before the
axis: the line of the surface and the estimate of the axis are both given. And the line is fitted
in depth alone: aside it is the model's, laid on the middle of what is seen, as a field of view that
ends on the blade shows a stretch which leans as its own edge does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.section_depth import MIN_POINTS, SectionDepth, depth_aslant, middle_aside
from perception.values import Float
from perception.voxel_hash import Int64, compiled

#: Points along the blade used each way from the vehicle's foot.
REACH_M = 6.0
#: A line is fitted to at most this many points.
FIT_POINTS = 1500
HYPOTHESES = 48
#: The edge of a blade seen edge-on is taken from so much of its length each way, and has so many of
#: the points before it.
EDGE_REACH_M, EDGE_SHARE = 3.0, 0.1


@dataclass(frozen=True, slots=True, eq=False)
class BladeLine:
    """The blade where the vehicle flies along it. World metres."""

    foot_w: Float
    """(3,) p_f: perpendicular foot of the vehicle on the estimated axis."""
    direction_w: Float
    """(3,) unit, root to tip: v of l_P."""
    distance_m: float
    """From the vehicle to `foot_w`."""
    surface_distance_m: float
    """From the vehicle to the near skin beside the foot."""
    residual_m: float
    """Root mean square of the points' distance from the fitted surface line."""
    points: int
    """Points of the blade used."""
    metre_m: float
    """Of the foot, along the modelled axis from its root."""
    offset_w: Float
    """(3,) estimated axis minus modelled axis at the foot, perpendicular to the model."""
    angle_rad: float
    """Between the fitted and the modelled direction."""
    tip_m: float | None
    """Metre at which the blade ends, where that was in view."""
    width_m: float
    """Lateral extent of the points at the foot, as the vehicle sees it."""


def fit_blade_line(
    points_w: Float,
    origin_w: Float,
    root_w: Float,
    tip_w: Float,
    half_width_m: float,
    *,
    half_thickness_m: float = 0.0,
    depth: SectionDepth | None = None,
    inlier_m: float = 0.35,
) -> BladeLine | None:
    """Return the line of the blade beside the vehicle, None where too little of it is seen.

    ``points_w``: (N, 3) world metres of the last scans; ``origin_w``: (3,) the vehicle p_d;
    ``root_w``, ``tip_w``: (3,) ends of the modelled axis; ``half_width_m``: how far from the
    model points are taken for the blade's (half a chord plus the model's error);
    ``half_thickness_m``: of the section as seen from here, from the near skin to the axis;
    ``depth``: the same along the blade, in its place.
    """
    axis = tip_w - root_w
    length = float(np.linalg.norm(axis))
    axis = axis / length
    station = float((origin_w - root_w) @ axis)
    beside = float(np.clip(station, 0.0, length))
    foot_model = root_w + beside * axis
    view = foot_model - origin_w
    view = view - (view @ axis) * axis
    reach = float(np.linalg.norm(view))
    if reach < 1e-3:
        return None
    view /= reach
    side: Float = np.asarray(np.cross(axis, view), np.float64)

    local = _select(
        np.ascontiguousarray(points_w, np.float64), root_w, axis, side, view,
        beside, REACH_M, half_width_m, half_width_m + half_thickness_m,
    )  # fmt: skip
    if len(local) < MIN_POINTS:
        return None
    if depth is not None:
        half_thickness_m = float(np.interp(beside, depth.metre_m, depth.depth_m))
        # A blade tapers: each point is brought to the depth that the section at the foot has.
        there = np.interp(local[:, 0], depth.metre_m, depth.depth_m)
        aslant = depth_aslant(local, beside, side, view, depth)
        there = there if aslant is None else aslant
        local = np.stack([local[:, 0], local[:, 1], local[:, 2] + there - half_thickness_m], axis=1)
    line = _line(local, beside, inlier_m)
    if line is None:
        return None
    slope, deep, residual_m = line
    if depth is not None and depth.edge:
        deep = _near_skin(local, beside, slope, deep, inlier_m)
    aside, width = middle_aside(local, beside, side, depth)

    direction = axis + slope * view
    direction /= np.linalg.norm(direction)
    surface = foot_model + aside * side + deep * view
    centre = surface + half_thickness_m * view
    foot = centre + ((origin_w - centre) @ direction) * direction
    offset = foot - root_w
    offset = offset - (offset @ axis) * axis
    return BladeLine(
        foot_w=foot,
        direction_w=direction,
        distance_m=float(np.linalg.norm(foot - origin_w)),
        surface_distance_m=float(np.linalg.norm(surface - origin_w)),
        residual_m=residual_m,
        points=len(local),
        metre_m=float((foot - root_w) @ axis),
        offset_w=offset,
        angle_rad=math.atan(abs(slope)),
        tip_m=_tip(local[:, 0], beside, length),
        width_m=width,
    )


def outside_cone(
    points_w: Float, end_w: Float, other_w: Float, radii_m: tuple[float, float]
) -> Float:
    """Return the points (M, 3) outside a truncated cone, such as the tower beside a blade.

    ``points_w``: (N, 3); ``end_w``, ``other_w``: (3,) ends of its axis; ``radii_m``: at each end.
    """
    axis = other_w - end_w
    length = float(np.linalg.norm(axis))
    axis = axis / max(length, 1e-9)
    offset = points_w - end_w
    along = offset @ axis
    square = np.einsum("nk,nk->n", offset, offset) - along**2
    share = np.clip(along / max(length, 1e-9), 0.0, 1.0)
    radius = radii_m[0] + (radii_m[1] - radii_m[0]) * share
    inside = (square < radius**2) & (along > -radii_m[0]) & (along < length + radii_m[1])
    outside: Float = points_w[~inside]
    return outside


@compiled
def _select(
    points: Float, root: Float, axis: Float, side: Float, view: Float, beside: float,
    reach: float, half_width: float, half_depth: float,
) -> Float:  # fmt: skip
    """Return (M, 3) of the points beside the vehicle: along, aside and deep of the model."""
    found = np.empty((len(points), 3))
    count = 0
    for n in range(len(points)):
        x, y, z = points[n, 0] - root[0], points[n, 1] - root[1], points[n, 2] - root[2]
        along = x * axis[0] + y * axis[1] + z * axis[2]
        if not (abs(along - beside) <= reach):
            continue
        aside = x * side[0] + y * side[1] + z * side[2]
        deep = x * view[0] + y * view[1] + z * view[2]
        if abs(aside) <= half_width and abs(deep) <= half_depth:
            found[count, 0], found[count, 1], found[count, 2] = along, aside, deep
            count += 1
    return found[:count]


def _line(local: Float, beside: float, inlier_m: float) -> tuple[float, float, float] | None:
    """Fit depth as a line over the metres from the foot: slope, depth at the foot, residual.

    RANSAC picks the line with the most points of the near skin, least squares refines it. A
    nearly square patch (little length in view) keeps the model's direction. Aside, what is seen
    leans as the field of view cuts the blade, far more than a blade does that hangs beside its
    model: its direction there is the model's.
    """
    step = max(len(local) // FIT_POINTS, 1)
    some = local[::step]
    along, deep = some[:, 0] - beside, np.ascontiguousarray(some[:, 2])
    rng = np.random.default_rng(len(local))
    pairs = rng.integers(0, len(some), (2, HYPOTHESES))
    slope, start, inlier = _ransac(along, deep, pairs, inlier_m)
    if int(inlier.sum()) < MIN_POINTS:
        return None
    spread = float(along[inlier].max() - along[inlier].min())
    width = float(np.ptp(some[inlier, 1]))
    if spread > max(2.0, 1.2 * width):
        for _ in range(2):
            rows = np.stack([along[inlier], np.ones(int(inlier.sum()))], axis=1)
            # Leaning from the model by 0.1 is as unlikely as a point 0.5 m off.
            weight = rows.T @ rows + np.diag([25.0, 0.0])
            slope, start = (float(x) for x in np.linalg.solve(weight, rows.T @ deep[inlier]))
            off = deep - start - along * slope
            inlier = np.abs(off) < inlier_m
            if int(inlier.sum()) < MIN_POINTS:
                return None
    else:
        slope, start = 0.0, float(np.median(deep[inlier]))
        off = deep - start
    # Depth is what the fit is judged by: aside, the chord itself spreads the points.
    residual = float(np.sqrt(np.mean(off[inlier] ** 2)))
    return slope, start, residual


@compiled
def _ransac(
    along: Float, deep: Float, pairs: Int64, inlier_m: float
) -> tuple[float, float, NDArray[np.bool_]]:
    best = -1
    slope = 0.0
    start = 0.0
    for h in range(pairs.shape[1]):
        i, j = pairs[0, h], pairs[1, h]
        gap = along[j] - along[i]
        if abs(gap) < 1.0:
            continue
        leans = (deep[j] - deep[i]) / gap
        if abs(leans) > 0.25:
            continue
        begins = deep[i] - leans * along[i]
        count = 0
        for n in range(len(along)):
            if abs(deep[n] - begins - leans * along[n]) < inlier_m:
                count += 1
        if count > best:
            best = count
            slope = leans
            start = begins
    if best < 0:
        start = float(np.median(deep))
    inlier = np.abs(deep - start - slope * along) < inlier_m
    return slope, start, inlier


def _near_skin(local: Float, beside: float, slope: float, deep: float, inlier_m: float) -> float:
    """Return the depth of the nearest skin at the foot: flanks go on behind an edge."""
    off = local[:, 2] - deep - slope * (local[:, 0] - beside)
    near = (np.abs(local[:, 0] - beside) < EDGE_REACH_M) & (np.abs(off) < inlier_m)
    if int(near.sum()) < MIN_POINTS:
        return deep
    return float(deep + np.quantile(off[near], EDGE_SHARE))


def _tip(along: Float, beside: float, length: float) -> float | None:
    """Return where the points end, if they end before the window does and near the model's tip."""
    last = float(np.quantile(along, 0.99))
    window_end = beside + REACH_M
    if last > window_end - 1.0 or abs(last - length) > 4.0:
        return None
    return last
