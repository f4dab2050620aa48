"""Blade rotation plane by RANSAC (Shi et al. 2025, Sec. III-B.1).

The normal v_n is the shaft's direction: nearly level, away from the drone that looks at the rotor
from the front.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from perception.values import Float
from perception.voxel_hash import compiled

HYPOTHESES = 256
#: Hypotheses are judged on at most this many points; the refinement uses all.
JUDGES = 1000


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
    judges = points_w[rng.permutation(len(points_w))[:JUDGES]]
    triples = judges[rng.integers(0, len(judges), (HYPOTHESES, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    size = np.linalg.norm(normals, axis=1)
    # A sliver of a triangle knows no normal.
    edges = np.linalg.norm(triples[:, 1] - triples[:, 0], axis=1)
    usable = (size > 1.0) & (edges > 1.0)
    usable &= np.abs(normals[:, 2]) < math.sin(math.radians(max_lean_deg)) * np.maximum(size, 1e-9)
    if not usable.any():
        return None
    normals = normals[usable] / size[usable, None]
    offsets = np.einsum("ij,ij->i", normals, triples[usable, 0])
    best = int(_most_supported(judges, normals, offsets, threshold_m))
    normal, offset = normals[best], float(offsets[best])

    inlier = np.abs(points_w @ normal - offset) < threshold_m
    for _ in range(3):
        if int(inlier.sum()) < min_inliers:
            return None
        centre = points_w[inlier].mean(axis=0)
        spread = points_w[inlier] - centre
        normal = np.linalg.eigh(spread.T @ spread)[1][:, 0]
        inlier = np.abs((points_w - centre) @ normal) < threshold_m
    if abs(normal[2]) > math.sin(math.radians(max_lean_deg)):
        return None
    if normal @ (centre - viewpoint_w) < 0:
        normal = -normal
    return RotorPlane(centre, normal, int(inlier.sum()))


@compiled
def _most_supported(judges: Float, normals: Float, offsets: Float, threshold: float) -> int:
    """Return which plane has the most judges (N, 3) near it."""
    best, most = 0, -1
    for k in range(len(normals)):
        count = 0
        a, b, c, d = normals[k, 0], normals[k, 1], normals[k, 2], offsets[k]
        for n in range(len(judges)):
            off = judges[n, 0] * a + judges[n, 1] * b + judges[n, 2] * c - d
            count += -threshold < off < threshold
        if count > most:
            best, most = k, count
    return best
