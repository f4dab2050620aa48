"""World points in the picture (Shi et al. 2025, Sec. III-C, Eq. 4: z_c [p_i; 1] = K [R t] p_w)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.values import CameraPose, Float

#: Nearer than this to the camera's plane a point has no useful place in the picture.
MIN_DEPTH_M = 0.1


def project(point_w: Float, camera: CameraPose, matrix: Float) -> Float | None:
    """Return the pixel (2,) of a world point (3,), None behind the camera.

    ``matrix``: (3, 3) K_c. The pixel may lie outside the picture.
    """
    pixels, ahead = project_all(np.asarray(point_w, np.float64)[None], camera, matrix)
    return np.asarray(pixels[0], np.float64) if ahead[0] else None


def project_all(
    points_w: Float, camera: CameraPose, matrix: Float
) -> tuple[Float, NDArray[np.bool_]]:
    """Return pixels (N, 2) of world points (N, 3), and which of them lie before the camera."""
    # A point that is nowhere is put into the camera: it then has no depth.
    finite = np.isfinite(points_w).all(axis=1, keepdims=True)
    points_c = np.where(finite, points_w - camera.position_w, 0.0) @ camera.rotation_wc
    ahead = points_c[:, 2] > MIN_DEPTH_M
    image = points_c @ matrix.T
    safe = np.where(ahead, image[:, 2], 1.0)
    return image[:, :2] / safe[:, None], ahead
