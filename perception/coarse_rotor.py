"""Coarse rotor from a cloud without a good prior: planes, then three arms in each plane.

A plane near the vertical is found by RANSAC; the points within it form an occupancy image, and
templates of three arms 120 deg apart are correlated with it (sum + 2 x the weakest arm).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from perception.rotor import down_in_plane, right_in_plane
from perception.values import Float, Float32
from perception.voxel_hash import compiled

CELL_M = 0.5
ANGLE_STEPS = 48
HYPOTHESES = 240
PLANE_THRESHOLD_M = 0.9
SAMPLE = 900
MIN_INLIERS = 20
"""Of the sample, and of the image."""
TILT_RAD = (math.radians(-7.0), math.radians(15.0))
"""Shafts rise upwind by 0-8 deg; attitude errs, and a plane of few points more."""


@dataclass(frozen=True, slots=True, eq=False)
class CoarseRotor:
    """A first guess of the rotor; ``angle_rad`` from straight down, modulo 120 deg."""

    hub_w: Float
    normal_w: Float
    angle_rad: float
    score: float
    arms_m: tuple[float, float, float]
    """Occupied length along each arm."""


def rotor_planes(
    points_w: Float,
    viewpoint_w: Float,
    prior_normal_w: Float | None,
    down_w: Float,
    count: int = 3,
) -> list[tuple[Float, float]]:
    """Return up to ``count`` (unit normal (3,), offset) planes, the most supported first.

    Normals have the tilt of a shaft and point away from the viewpoint (or along
    ``prior_normal_w``, within 40 deg of it). Deterministic: the draws have a fixed seed.
    """
    rng = np.random.default_rng(12345)
    # Points come in the order of their time: every so many of them are a fair sample.
    sample = points_w[:: -(-len(points_w) // SAMPLE) or 1]
    if len(sample) < 30:
        return []
    triples = sample[rng.integers(len(sample), size=(HYPOTHESES, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    norms = np.linalg.norm(normals, axis=1)
    wide = norms > 4.0  # twice the triangle's area: slivers say nothing
    normals = normals[wide] / norms[wide, None]
    anchors = triples[wide, 0]
    towards = prior_normal_w if prior_normal_w is not None else None
    facing = (
        np.einsum("ij,ij->i", normals, anchors - viewpoint_w)
        if towards is None
        else normals @ towards
    )
    normals = np.where(facing[:, None] < 0, -normals, normals)
    sink = normals @ down_w  # sine of the tilt
    upright = (sink > math.sin(TILT_RAD[0])) & (sink < math.sin(TILT_RAD[1]))
    if towards is not None:
        upright &= np.abs(facing) > math.cos(math.radians(40))
    normals, anchors = normals[upright], anchors[upright]
    if len(normals) == 0:
        return []
    offsets = np.einsum("ij,ij->i", normals, anchors)
    near = np.abs(sample @ normals.T - offsets) < PLANE_THRESHOLD_M
    support = near.sum(axis=0)
    middle = np.median(sample, axis=0)
    depth = offsets - normals @ middle
    planes: list[tuple[Float, float]] = []
    while len(planes) < count:
        k = int(np.argmax(support))
        inliers = sample[near[:, k]]
        if support[k] < MIN_INLIERS:
            break
        plane = _refit(inliers, normals[k], down_w)
        planes.append(plane)
        gap = depth - plane[1] + plane[0] @ middle
        alike = np.abs(normals @ plane[0]) > math.cos(math.radians(12))
        support = np.where(alike & (np.abs(gap) < 2.0), 0, support)
        support[k] = 0
    return planes


def _refit(inliers_w: Float, normal_w: Float, down_w: Float) -> tuple[Float, float]:
    centre = np.median(inliers_w, axis=0)
    _, _, rows = np.linalg.svd(inliers_w - centre, full_matrices=False)
    fitted: Float = rows[2] if rows[2] @ normal_w > 0 else -rows[2]
    tilted = not math.sin(TILT_RAD[0]) < fitted @ down_w < math.sin(TILT_RAD[1])
    if tilted or fitted @ normal_w < 0.97:
        fitted = normal_w
    return fitted, float(np.median(inliers_w @ fitted))


def three_arms(
    points_w: Float,
    plane: tuple[Float, float],
    down_w: Float,
    search_centre_w: Float,
    search_radius_m: float,
    radius_m: float,
) -> CoarseRotor | None:
    """Return the best hub and angle within one plane, or None when the image is empty."""
    normal, offset = plane
    down, right = down_in_plane(normal, down_w), right_in_plane(normal, down_w)
    centre = search_centre_w - (search_centre_w @ normal - offset) * normal
    reach = min(radius_m, 26.0)
    half = search_radius_m + reach + 2.0
    size = int(2 * half / CELL_M) + 1
    spread = np.zeros((size, size), np.float32)
    held = _spread(
        points_w, centre, np.stack([right, down, normal]), half, 0.9 + 0.028 * radius_m, spread
    )
    if held < MIN_INLIERS:
        return None
    first, last = int(max(1.5, 0.05 * radius_m) / CELL_M), int(reach / CELL_M)
    start = _correlate(spread, size // 2, int(search_radius_m / CELL_M), first, last)
    score, cu, cv, step, a0, a1, a2 = _correlate_near(spread, *start, first, last)
    hub = centre + (cu * CELL_M - half) * right + (cv * CELL_M - half) * down
    angle = 2 * math.pi / 3 * step / ANGLE_STEPS
    return CoarseRotor(hub, normal, angle, float(score), (a0 * CELL_M, a1 * CELL_M, a2 * CELL_M))


@compiled
def _spread(
    points: Float, centre: Float, axes: Float, half: float, deep: float, image: Float32
) -> int:
    """Fill the occupancy image of the points (N, 3) near a plane; return how many there are.

    ``axes``: (3, 3) rows right, down, normal. Every occupied cell is spread to its four
    neighbours, so that an arm may be a cell wide.
    """
    size = len(image)
    occupied = np.zeros((size, size), np.bool_)
    held = 0
    for n in range(len(points)):
        x, y, z = points[n, 0] - centre[0], points[n, 1] - centre[1], points[n, 2] - centre[2]
        if abs(x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2]) >= deep:
            continue
        u = x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2]
        v = x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2]
        if abs(u) < half and abs(v) < half:
            occupied[int((u + half) / CELL_M), int((v + half) / CELL_M)] = True
            held += 1
    for i in range(size):
        for j in range(size):
            if not occupied[i, j]:
                continue
            image[i, j] += np.float32(0.4)
            if i + 1 < size:
                image[i + 1, j] += np.float32(0.15)
            if i > 0:
                image[i - 1, j] += np.float32(0.15)
            if j + 1 < size:
                image[i, j + 1] += np.float32(0.15)
            if j > 0:
                image[i, j - 1] += np.float32(0.15)
    return held


@compiled
def _arm(
    image: Float32, cu: float, cv: float, angle: float, first: int, last: int, stride: int
) -> float:
    """Occupied cells along one arm from its ``first`` to its ``last`` cell."""
    total = 0.0
    u_step, v_step = math.sin(angle), math.cos(angle)
    n = image.shape[0]
    for k in range(first, last, stride):
        i, j = int(cu + k * u_step + 0.5), int(cv + k * v_step + 0.5)
        if 0 <= i < n and 0 <= j < n:
            total += image[i, j]
    return total * stride


@compiled
def _scored(
    image: Float32, cu: float, cv: float, step: float, first: int, last: int, stride: int
) -> tuple[float, float, float, float]:
    """Return sum + 2 x the weakest arm, and the three arms."""
    base = 2 * math.pi / 3 * step / ANGLE_STEPS
    a = _arm(image, cu, cv, base, first, last, stride)
    b = _arm(image, cu, cv, base + 2 * math.pi / 3, first, last, stride)
    c = _arm(image, cu, cv, base + 4 * math.pi / 3, first, last, stride)
    return a + b + c + 2 * min(a, b, c), a, b, c


@compiled
def _correlate(
    image: Float32, middle: int, span: int, first: int, last: int
) -> tuple[float, float, float]:
    """Return the best place and angle step on a grid of every other cell and step."""
    n = image.shape[0]
    cells = (last - first + 1) // 2
    best, best_u, best_v, best_step = -1.0, 0.0, 0.0, 0.0
    du, dv = np.empty((3, cells), np.int64), np.empty((3, cells), np.int64)
    arms = np.empty(3)
    for step in range(0, ANGLE_STEPS, 2):
        for k in range(3):
            angle = 2 * math.pi / 3 * (k + step / ANGLE_STEPS)
            for c in range(cells):
                du[k, c] = round((first + 2 * c) * math.sin(angle))
                dv[k, c] = round((first + 2 * c) * math.cos(angle))
        for i in range(middle - span, middle + span + 1, 2):
            for j in range(middle - span, middle + span + 1, 2):
                if (i - middle) ** 2 + (j - middle) ** 2 > span * span:
                    continue
                for k in range(3):
                    total = 0.0
                    for c in range(cells):
                        p, q = i + du[k, c], j + dv[k, c]
                        if 0 <= p < n and 0 <= q < n:
                            total += image[p, q]
                    arms[k] = total
                score = arms.sum() + 2 * arms.min()
                if score > best:
                    best, best_u, best_v, best_step = score, float(i), float(j), float(step)
    return best_u, best_v, best_step


@compiled
def _correlate_near(
    image: Float32, u: float, v: float, step: float, first: int, last: int
) -> tuple[float, float, float, float, float, float, float]:
    """Return the best score, place, angle step and arms round a place and step."""
    best = (-1.0, u, v, step, 0.0, 0.0, 0.0)
    for du in range(-3, 4):
        for dv in range(-3, 4):
            for turn in range(-5, 6):
                at_u, at_v, at_step = u + 0.7 * du, v + 0.7 * dv, step + 0.6 * turn
                score, a, b, c = _scored(image, at_u, at_v, at_step, first, last, 1)
                if score > best[0]:
                    best = (score, at_u, at_v, at_step, a, b, c)
    return best
