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
    ahead_w: Float | None = None,
    max_turn_deg: float = 180.0,
    lean_deg: tuple[float, float] = (-20.0, 20.0),
    min_inliers: int = 60,
) -> RotorPlane | None:
    """Return the plane that holds the most points, None where none is upright and full enough.

    ``points_w``: (N, 3) P_a, world metres; ``viewpoint_w``: (3,) p_d; ``threshold_m``: distance
    of an inlier; ``ahead_w``: (3,) where the drone looks, the points' middle if not told: v_n lies
    within ``max_turn_deg`` of it, seen from above, and within ``lean_deg`` of the level: negative
    where the rotor's top leans back.
    """
    if len(points_w) < min_inliers:
        return None
    rng = np.random.default_rng(len(points_w))
    points = np.ascontiguousarray(points_w, np.float64)
    judges = points
    if len(points) > JUDGES:
        judges = points[rng.choice(len(points), JUDGES, replace=False, shuffle=False)]
    triples = rng.integers(0, len(judges), (HYPOTHESES, 3))
    towards = (points.mean(axis=0) - viewpoint_w if ahead_w is None else ahead_w)[:2]
    level = towards / max(float(np.linalg.norm(towards)), 1e-9)
    low, high = np.sin(np.deg2rad(lean_deg))
    limits = np.array([*level, math.cos(math.radians(max_turn_deg)), low, high])
    normal, offset, most = _most_supported(judges, triples, limits, threshold_m)
    if most < 0:
        return None
    for _ in range(ROUNDS):
        inliers, centre, spread = _gathered(points, normal, offset, threshold_m)
        if inliers < min_inliers:
            return None
        refined = np.ascontiguousarray(np.linalg.eigh(spread)[1][:, 0])
        refined *= 1.0 if refined @ normal > 0 else -1.0
        if not _allowed(refined[0], refined[1], refined[2], limits):
            break
        normal, offset = refined, float(centre @ refined)
    inliers, centre, _ = _gathered(points, normal, offset, threshold_m)
    if normal @ (centre - viewpoint_w) < 0:
        normal = -normal
    return RotorPlane(centre, normal, inliers)


@compiled
def _allowed(a: float, b: float, c: float, limits: Float) -> bool:
    """Return whether a unit normal that points ahead is one of a rotor's.

    ``limits``: x, y of the level unit direction ahead, cosine of the most turn from it, sines of
    the least and the most lean.
    """
    level = math.sqrt(a * a + b * b)
    ahead = a * limits[0] + b * limits[1]
    inside: bool = limits[3] < c < limits[4] and ahead >= limits[2] * level
    return inside


@compiled
def _most_supported(
    judges: Float, triples: Int64, limits: Float, threshold: float
) -> tuple[Float, float, int]:
    """Return normal (3,) and offset of the plane through three judges with the most of them near.

    And how many those are, -1 where no three judges span a plane within the limits.

    ``judges``: (N, 3); ``triples``: (K, 3) their numbers; ``limits``: as of `_allowed`.
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
        if a * limits[0] + b * limits[1] < 0.0:
            size = -size
        a, b, c = a / size, b / size, c / size
        if not _allowed(a, b, c, limits):
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
