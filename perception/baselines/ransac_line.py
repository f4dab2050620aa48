"""A straight line in the plane by RANSAC, refitted by orthogonal regression on its inliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.values import Float

HYPOTHESES = 200
#: Hypotheses are judged on at most this many points; the refinement uses all.
JUDGES = 1200
REFITS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """An undirected line through the middle of its inliers."""

    middle: Float
    """(2,)"""
    direction: Float
    """(2,) unit"""
    length: float
    """Between the 2nd and the 98th percentile of the inliers."""
    inlier: NDArray[np.bool_]
    """(N,) among the points given."""

    @property
    def normal(self) -> Float:
        """Return the (2,) unit normal."""
        return np.array([-self.direction[1], self.direction[0]])


def fit_line(
    points: Float, *, threshold: float, min_inliers: int, min_length: float
) -> Line | None:
    """Return the line that holds the most of (N, 2) points, None where none is full enough.

    ``threshold``: distance of an inlier; ``min_length``: extent of the inliers along the line.
    Repeatable: the draw is fixed by the number of points.
    """
    if len(points) < min_inliers:
        return None
    rng = np.random.default_rng(len(points))
    judges = points[rng.permutation(len(points))[:JUDGES]]
    pairs = judges[rng.integers(0, len(judges), (HYPOTHESES, 2))]
    along = pairs[:, 1] - pairs[:, 0]
    size = np.linalg.norm(along, axis=1)
    usable = size > 0.25 * min_length
    if not usable.any():
        return None
    along = along[usable] / size[usable, None]
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    offsets = np.einsum("ij,ij->i", normals, pairs[usable, 0])
    votes = (np.abs(judges @ normals.T - offsets) < threshold).sum(axis=0)
    best = int(np.argmax(votes))
    inlier = np.abs(points @ normals[best] - offsets[best]) < threshold
    return _refitted(points, inlier, threshold, min_inliers, min_length)


def _refitted(
    points: Float,
    inlier: NDArray[np.bool_],
    threshold: float,
    min_inliers: int,
    min_length: float,
) -> Line | None:
    for _ in range(REFITS):
        if int(inlier.sum()) < min_inliers:
            return None
        middle = points[inlier].mean(axis=0)
        spread = points[inlier] - middle
        direction: Float = np.linalg.eigh(spread.T @ spread)[1][:, 1]
        normal = np.array([-direction[1], direction[0]])
        inlier = np.abs((points - middle) @ normal) < threshold
    if int(inlier.sum()) < min_inliers:
        return None
    low, high = np.percentile((points[inlier] - middle) @ direction, (2, 98))
    length = float(high - low)
    return Line(middle, direction, length, inlier) if length >= min_length else None
