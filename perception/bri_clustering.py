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
    labels = dbscan(np.ascontiguousarray(cells_w, np.float64), eps_m, min_samples)
    groups = range(int(labels.max()) + 1)
    return np.array([cells_w[labels == group].mean(axis=0) for group in groups]).reshape(-1, 3)


@compiled
def dbscan(points: Float, eps: float, min_samples: int) -> Int64:
    """Return a group's number for each point (N, 3), -1 for noise (Ester et al., 1996)."""
    count = len(points)
    near = np.zeros((count, count), np.bool_)
    for i in range(count):
        for j in range(count):
            x, y, z = points[i] - points[j]
            near[i, j] = x * x + y * y + z * z <= eps * eps
    labels = np.full(count, -1)
    stack = np.empty(count, np.int64)
    group = 0
    for seed in range(count):
        if labels[seed] >= 0 or near[seed].sum() < min_samples:
            continue
        labels[seed], stack[0], left = group, seed, 1
        while left > 0:
            left -= 1
            at = stack[left]
            # A border point belongs to the group but does not carry it on.
            if near[at].sum() < min_samples:
                continue
            for j in range(count):
                if near[at, j] and labels[j] < 0:
                    labels[j] = group
                    stack[left] = j
                    left += 1
        group += 1
    return labels
