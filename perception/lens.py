"""A calibrated lens: from directions to pixels and back, with distortion.

Brown and Conrady's model in OpenCV's order: k1, k2, p1, p2, k3. Pixel (0, 0) is the corner of the
first pixel, so that a picture's centre is half its size. Optical frame: x right, y down, z ahead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.sensors import Camera
from perception.projection import MIN_DEPTH_M
from perception.values import Float

#: Farther out than this (tangent of the angle off the axis) a polynomial lens is not to be trusted.
_WIDEST = 4.0
#: Rounds in which a pixel is freed of distortion; each gains a digit or more.
_ROUNDS = 30


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """Camera matrix (3, 3) and distortion (5,) of pictures of one size."""

    matrix: Float
    distortion: Float
    width_px: int
    height_px: int

    @property
    def focal_px(self) -> float:
        """Focal length in pixels across the picture."""
        return float(self.matrix[0, 0])

    def pixels(self, points_c: Float) -> tuple[Float, NDArray[np.bool_]]:
        """Return pixels (N, 2) of points (N, 3) in the optical frame, and which lie ahead."""
        ahead = points_c[:, 2] > np.maximum(
            MIN_DEPTH_M, np.abs(points_c[:, :2]).max(axis=1) / _WIDEST
        )
        safe = np.where(ahead[:, None], points_c, [[0.0, 0.0, 1.0]])
        flat = self._distorted(safe[:, :2] / safe[:, 2:])
        image = np.column_stack([flat, np.ones(len(flat))]) @ self.matrix.T
        return np.asarray(image[:, :2], np.float64), ahead

    def rays(self, pixels: Float) -> Float:
        """Return unit directions (N, 3) in the optical frame through pixels (N, 2)."""
        image = np.asarray(pixels, np.float64).reshape(-1, 2)
        wanted = (image - self.matrix[:2, 2]) / np.diag(self.matrix)[:2]
        flat = wanted
        for _ in range(_ROUNDS if self.distortion.any() else 0):
            flat = flat + wanted - self._distorted(flat)
        rays = np.column_stack([flat, np.ones(len(flat))])
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True), np.float64)

    def _distorted(self, flat: Float) -> Float:
        """Return where the lens moves (N, 2) tangents of the angle off the axis."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = flat[:, 0], flat[:, 1]
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        return np.column_stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
                y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
            ]
        )


def lens_of(camera: Camera, width_px: int, height_px: int) -> Lens:
    """Return the lens of pictures stored at a size, from the camera's at its full size."""
    focal = camera.focal_length_mm / camera.sensor_width_mm * width_px
    scale = (width_px / camera.width_px, height_px / camera.height_px)
    full = camera.principal_point_px or (camera.width_px / 2, camera.height_px / 2)
    matrix = np.array(
        [[focal, 0.0, full[0] * scale[0]], [0.0, focal, full[1] * scale[1]], [0.0, 0.0, 1.0]]
    )
    return Lens(matrix, np.array(camera.distortion), width_px, height_px)
