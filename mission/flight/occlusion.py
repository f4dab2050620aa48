"""What the tower hides: skin behind it, seen from beside the turbine."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mission.flight.rotor_model import RotorModel
from perception.values import Float

Mask = NDArray[np.bool_]


def behind_tower(eyes_w: Float, points_w: Float, model: RotorModel, margin_m: float = 0.0) -> Mask:
    """Return (N,) whether the tower lies between an eye and its point, both (N, 3).

    Where a line of sight passes the tower's axis nearest, level, decides. ``margin_m``: so near to
    the tower counts as behind it too.
    """
    top_w, axis_w = model.tower_top_w, model.tower_axis_w
    lean = axis_w[:2] / axis_w[2]
    # Seen along the axis the tower is a disc at one place, however it leans.
    eye = eyes_w[:, :2] - (eyes_w[:, 2:] - top_w[2]) * lean - top_w[:2]
    way = points_w[:, :2] - (points_w[:, 2:] - top_w[2]) * lean - top_w[:2] - eye
    length_sq = np.maximum(np.einsum("ij,ij->i", way, way), 1e-9)
    share = np.clip(-np.einsum("ij,ij->i", eye, way) / length_sq, 0.0, 1.0)
    apart = np.linalg.norm(eye + share[:, None] * way, axis=1)
    height = eyes_w[:, 2] + share * (points_w[:, 2] - eyes_w[:, 2])
    base, top = model.tower_radii
    above = np.clip((height - (top_w[2] - model.tower_height_m)) / model.tower_height_m, 0.0, 1.0)
    hidden: Mask = (apart < base + above * (top - base) + margin_m) & (height < top_w[2])
    return hidden
