"""Blade-ring intersections grouped into three blades (Shi et al. 2025, Sec. III-B.2)."""

from __future__ import annotations

import numpy as np

from perception.values import Float
from perception.voxel_hash import Int64, compiled


def cluster_bri(cells_w: Float, *, eps_m: float, min_samples: int) -> Float:
    """Return the centres Q_b (k, 3) of the groups of occupied ring cells Q_t.

    ``cells_w``: (K, 3) centres of distinct cells; DBSCAN with ``eps_m``, ``min_samples``. A rotor
    is found where k is 3. An eps of a few cells splits a blade: it has to bridge a chord's gaps.
    """
    if not len(cells_w):
        return np.empty((0, 3))
    cells = np.ascontiguousarray(cells_w, np.float64)
    return np.asarray(_centres(cells, dbscan(cells, eps_m, min_samples)), np.float64)


@compiled
def _centres(points: Float, labels: Int64) -> Float:
    """Return the mean of each group of points (N, 3), one a row."""
    groups = labels.max() + 1
    centres, count = np.zeros((groups, 3)), np.zeros(groups)
    for n in range(len(points)):
        if labels[n] >= 0:
            centres[labels[n]] += points[n]
            count[labels[n]] += 1.0
    for group in range(groups):
        centres[group] /= count[group]
    return centres


@compiled
def dbscan(points: Float, eps: float, min_samples: int) -> Int64:
    """Return a group's number for each point (N, 3), -1 for noise (Ester et al., 1996)."""
    count = len(points)
    near = np.zeros((count, count), np.bool_)
    around = np.zeros(count, np.int64)
    for i in range(count):
        for j in range(count):
            x, y = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
            z = points[i, 2] - points[j, 2]
            near[i, j] = x * x + y * y + z * z <= eps * eps
            around[i] += near[i, j]
    labels = np.full(count, -1)
    stack = np.empty(count, np.int64)
    group = 0
    for seed in range(count):
        if labels[seed] >= 0 or around[seed] < min_samples:
            continue
        labels[seed], stack[0], left = group, seed, 1
        while left > 0:
            left -= 1
            at = stack[left]
            # A border point belongs to the group but does not carry it on.
            if around[at] < min_samples:
                continue
            for j in range(count):
                if near[at, j] and labels[j] < 0:
                    labels[j] = group
                    stack[left] = j
                    left += 1
        group += 1
    return labels
