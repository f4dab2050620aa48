"""Blade-ring intersections grouped into three blades (Shi et al. 2025, Sec. III-B.2)."""

from __future__ import annotations

import numpy as np
from sklearn.cluster import DBSCAN

from perception.values import Float


def cluster_bri(cells_w: Float, *, eps_m: float, min_samples: int) -> Float:
    """Return the centres Q_b (k, 3) of the groups of occupied ring cells Q_t.

    ``cells_w``: (K, 3) centres of distinct cells; DBSCAN with ``eps_m``, ``min_samples``. A rotor
    is found where k is 3. An eps of a few cells splits a blade: it has to bridge a chord's gaps.
    """
    if not len(cells_w):
        return np.empty((0, 3))
    labels = DBSCAN(eps=eps_m, min_samples=min_samples).fit_predict(cells_w)
    groups = range(int(labels.max()) + 1)
    return np.array([cells_w[labels == group].mean(axis=0) for group in groups]).reshape(-1, 3)
