"""Blade rotation plane by RANSAC (Shi et al. 2025, Sec. III-B.1).

The normal v_n is the shaft's direction: nearly level, away from the drone that looks at the rotor
from the front.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from perception.values import Float
from perception.voxel_hash import Int64, compiled

HYPOTHESES, ROUNDS = 800, 3
#: Hypotheses are judged on at most this many points; the refinement uses all.
JUDGES = 500


@dataclass(frozen=True, slots=True, eq=False)
class RotorPlane:
    """Pi_P: the plane of the blades."""

    point_w: Float
    """(3,) centre of the inliers."""
    normal_w: Float
    """(3,) unit v_n, away from the viewpoint."""
    inliers: int


def fit_rotor_plane(
    points_w: Float,
    viewpoint_w: Float,
    *,
    threshold_m: float,
    max_lean_deg: float = 20.0,
    min_inliers: int = 60,
) -> RotorPlane | None:
    """Return the plane that holds the most points, None where none is upright and full enough.

    ``points_w``: (N, 3) P_a, world metres; ``viewpoint_w``: (3,) p_d; ``threshold_m``: distance
    of an inlier; ``max_lean_deg``: of the normal out of the level (tilt is about 5).
    """
    if len(points_w) < min_inliers:
        return None
    rng = np.random.default_rng(len(points_w))
    points = np.ascontiguousarray(points_w, np.float64)
    judges = points
    if len(points) > JUDGES:
        judges = points[rng.choice(len(points), JUDGES, replace=False, shuffle=False)]
    triples = rng.integers(0, len(judges), (HYPOTHESES, 3))
    steepest = math.sin(math.radians(max_lean_deg))
    normal, offset, most = _most_supported(judges, triples, steepest, threshold_m)
    if most < 0:
        return None
    for _ in range(ROUNDS):
        inliers, centre, spread = _gathered(points, normal, offset, threshold_m)
        if inliers < min_inliers:
            return None
        normal = np.ascontiguousarray(np.linalg.eigh(spread)[1][:, 0])
        offset = float(centre @ normal)
    inliers, centre, _ = _gathered(points, normal, offset, threshold_m)
    if abs(normal[2]) > steepest:
        return None
    if normal @ (centre - viewpoint_w) < 0:
        normal = -normal
    return RotorPlane(centre, normal, inliers)


@compiled
def _most_supported(
    judges: Float, triples: Int64, steepest: float, threshold: float
) -> tuple[Float, float, int]:
    """Return normal (3,) and offset of the upright plane through three judges with most near it.

    And how many those are, -1 where no three judges span an upright plane.

    ``judges``: (N, 3); ``triples``: (K, 3) their numbers; ``steepest``: sine of the most lean.
    """
    normal, offset, most = np.zeros(3), 0.0, -1
    for t in range(len(triples)):
        p = judges[triples[t, 0]]
        x, y = judges[triples[t, 1]] - p, judges[triples[t, 2]] - p
        a, b, c = x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]
        size = math.sqrt(a * a + b * b + c * c)
        # A sliver of a triangle knows no normal.
        if size <= 1.0 or x[0] * x[0] + x[1] * x[1] + x[2] * x[2] <= 1.0:
            continue
        a, b, c = a / size, b / size, c / size
        if abs(c) >= steepest:
            continue
        d = a * p[0] + b * p[1] + c * p[2]
        count = 0
        for n in range(len(judges)):
            off = judges[n, 0] * a + judges[n, 1] * b + judges[n, 2] * c - d
            count += -threshold < off < threshold
        if count > most:
            normal[0], normal[1], normal[2] = a, b, c
            offset, most = d, count
    return normal, offset, most


@compiled
def _gathered(
    points: Float, normal: Float, offset: float, threshold: float
) -> tuple[int, Float, Float]:
    """Return how many points lie near a plane, their centre (3,) and their spread (3, 3)."""
    count, first = 0, np.zeros(3)
    total, square = np.zeros(3), np.zeros((3, 3))
    away = np.zeros(3)
    for n in range(len(points)):
        off = points[n, 0] * normal[0] + points[n, 1] * normal[1] + points[n, 2] * normal[2]
        if not -threshold < off - offset < threshold:
            continue
        if count == 0:
            first[:] = points[n]
        count += 1
        for a in range(3):
            away[a] = points[n, a] - first[a]
            total[a] += away[a]
            for b in range(a + 1):
                square[a, b] += away[a] * away[b]
    mean = total / max(count, 1)
    for a in range(3):
        for b in range(a + 1):
            square[a, b] -= count * mean[a] * mean[b]
            square[b, a] = square[a, b]
    return count, first + mean, square
