"""Where in a photo the blade truly lies: its middle from the picture's, by the true mesh."""

from __future__ import annotations

import math

import numpy as np

from config.sensors import Camera
from drivers.simulated.mesh import Mesh, Part
from perception.values import CameraPose, Float

#: Half of the blade's length about the optical axis that its middle is taken from.
_ABOUT_M = 0.6
#: A blade that fills more of the picture's shorter side is photographed in rows, beside its middle.
_FILLS = 0.9
BLADES = (Part.BLADE_0, Part.BLADE_1, Part.BLADE_2)


class BladeOutline:
    """The vertices of one blade's skin with their metres."""

    def __init__(self, mesh: Mesh, part: Part) -> None:
        rows = np.unique(mesh.triangles[mesh.part == part])
        self.points_w = mesh.vertices[rows].astype(np.float64)
        self.metres = mesh.metre[rows]

    def across(
        self, metre: float, eye_w: Float, across_w: Float, along_w: Float
    ) -> tuple[float, float] | None:
        """Return where the blade's edges lie across the sight, as tangents to the axis.

        ``across_w``, ``along_w``: unit vectors (3,), of the sight the second.
        """
        near = np.abs(self.metres - metre) < _ABOUT_M
        if not near.any():
            return None
        rays = self.points_w[near] - eye_w
        tangent = (rays @ across_w) / (rays @ along_w)
        return float(tangent.min()), float(tangent.max())

    def nearest(self, pose: CameraPose) -> tuple[float, float]:
        """Return the angle (rad) from the optical axis to the blade, and its metre there."""
        rays = self.points_w - pose.position_w
        cosine = rays @ pose.rotation_wc[:, 2] / np.linalg.norm(rays, axis=1)
        k = int(cosine.argmax())
        return math.acos(min(1.0, float(cosine[k]))), float(self.metres[k])


def off_centre(
    outlines: list[BladeOutline], axes_w: list[Float], pose: CameraPose, camera: Camera
) -> float | None:
    """Return how far the photographed blade's middle is from the picture's, a share of its width.

    The blade is the one nearest to the optical axis; ``axes_w``: unit vectors (3,) along each.
    Infinite where it is out of the picture; None where it is about as wide as it.
    """
    found = [outline.nearest(pose) for outline in outlines]
    k = min(range(len(found)), key=lambda one: found[one][0])
    sight = pose.rotation_wc[:, 2]
    across: Float = np.asarray(np.cross(sight, axes_w[k]), np.float64)
    edges = outlines[k].across(
        found[k][1], pose.position_w, across / float(np.linalg.norm(across)), sight
    )
    width = camera.sensor_width_mm / camera.focal_length_mm
    height = camera.sensor_height_mm / camera.focal_length_mm
    if edges is None:
        return math.inf
    if edges[1] - edges[0] > _FILLS * height:
        return None
    middle = 0.5 * (edges[0] + edges[1])
    return middle / width if abs(middle) <= 0.5 * math.hypot(width, height) else math.inf
