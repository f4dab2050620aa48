"""Hub centre as the Fermat point of the three blade-ring intersections.

Three blades 120 deg apart cut a ring round the hub in three points; the point that sees each pair
of them under 120 deg is the hub (Shi et al. 2025, Definition 1 and Proposition 1, Sec. III-B.3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from perception.values import Float

#: Beyond this interior angle the geometric median is a vertex, not a hub.
MAX_INTERIOR_ANGLE_RAD = float(np.deg2rad(120.0))


class DegenerateTriangleError(ValueError):
    """The three points are collinear or coincide, so they span no rotor."""


class ObtuseTriangleError(ValueError):
    """An interior angle is 120 deg or more: these are not three blades."""


@dataclass(frozen=True, slots=True, eq=False)
class FermatHub:
    """Hub centre p_h and the blade directions V_b seen from it, in the points' frame."""

    centre_w: Float
    """(3,) metres"""
    blade_directions_w: Float
    """(3, 3) one unit vector a row, in the order given."""
    arms_m: Float
    """(3,) distance of each point from the centre."""


def fermat_hub(bri_points_w: Float) -> FermatHub:
    """Return the hub whose blades pass through three blade-ring intersections.

    ``bri_points_w``: (3, 3) Q_b, one point a row, world metres.

    Raises ``DegenerateTriangleError`` or ``ObtuseTriangleError`` where no hub exists.
    """
    angles_rad = _interior_angles(bri_points_w)
    if angles_rad.max() >= MAX_INTERIOR_ANGLE_RAD:
        raise ObtuseTriangleError(f"interior angle {np.rad2deg(angles_rad.max()):.1f} deg")

    # First isogonic centre in barycentric coordinates: a_i / sin(A_i + 60 deg).
    sides_m = np.linalg.norm(
        np.roll(bri_points_w, -1, axis=0) - np.roll(bri_points_w, 1, axis=0), axis=1
    )
    weights = sides_m / np.sin(angles_rad + np.pi / 3)
    centre_w = weights @ bri_points_w / weights.sum()

    rays_w = bri_points_w - centre_w
    arms_m = np.linalg.norm(rays_w, axis=1)
    return FermatHub(centre_w, rays_w / np.maximum(arms_m, 1e-9)[:, None], arms_m)


def _interior_angles(points: Float) -> Float:
    to_next = np.roll(points, -1, axis=0) - points
    to_last = np.roll(points, 1, axis=0) - points
    crossed = np.linalg.norm(np.cross(to_next, to_last), axis=1)
    if crossed.max() < 1e-9:
        raise DegenerateTriangleError("the blade-ring intersections span no area")
    return np.asarray(np.arctan2(crossed, np.einsum("ij,ij->i", to_next, to_last)), np.float64)
