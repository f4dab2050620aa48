"""Stop angle by a plane and lines in a cloud: 'our reading' of BladeView (Yang et al. 2024).

What is known is one sentence of Shi et al. 2025 (Sec. II): BladeView takes the stop angle from a
point cloud by geometric relationships and linear fitting, and may lose accuracy where the angle is
far from 60 deg. Its text could not be had, so every step here is ours, chosen to be that sentence:

- The rotor plane is found by the same RANSAC as in the paper's method (`rotor_plane`), on the
  returns within ``reach_m`` of the prior hub and farther than 9 m from the sensor. Points farther
  than ``slab_m`` from it (the tower, the nacelle, the ground) are left out; the rest is projected
  on it: x to the right, y down, origin at the prior hub.
- Left out as well: a disc round the hub.
- `Variant.TWO_LINES`: the strip in which the tower hangs (|x| < ``tower_half_m``) is left out, and
  above the hub too: at 60 deg the third blade stands there, in both halves. One line on either
  side, by RANSAC and orthogonal regression; an inlier lies within about half a chord. The hub is
  where the two meet. Each gives the angle modulo 120; the result is their circular mean. Sides
  that differ by more than 10 deg are refused. At 60 deg each half holds one whole blade. Far from
  it the third blade enters a half, and the strip swallows the foot of the lower one: the weakness
  that Shi et al. name.
- `Variant.THREE_LINES`, a fairer rival of our own: no strip; three lines one after the other, each
  from what the last ones left; their least-squares meeting point is the hub; the 120 deg are
  enforced by the mean on the circle of three times the angle, weighted by length x inliers.

Blade pitch is not measured. The viewer is taken to stand in front of the rotor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from perception.baselines.ransac_line import Line, fit_line
from perception.geometry import stop_angle_difference_deg
from perception.rotor import (
    Blade,
    Refusal,
    RefusalCode,
    Rotor,
    blade_angles_deg,
    direction_at,
    down_in_plane,
    right_in_plane,
)
from perception.rotor_plane import RotorPlane, fit_rotor_plane
from perception.values import Float

DOWN_W: Float = np.array([0.0, 0.0, -1.0])


class Variant(StrEnum):
    """Which lines are fitted."""

    TWO_LINES = "line_fit_two"
    THREE_LINES = "line_fit_three"


@dataclass(frozen=True, slots=True)
class LineFitSettings:
    """Parameters; metres unless named otherwise."""

    nearest_m: float = 9.0
    """Nothing nearer to the sensor is a blade."""
    reach_m: float = 25.0
    """Round the prior hub."""
    plane_threshold_m: float = 0.6
    slab_m: float = 1.2
    """Half thickness of the slab about the plane: half a chord, cone and prebend."""
    tower_half_m: float = 2.5
    hub_radius_m: float = 3.0
    line_threshold_m: float = 0.8
    min_inliers: int = 40
    min_length_m: float = 3.0
    max_disagreement_deg: float = 10.0


def fit_rotor_by_lines(
    points_w: Float,
    origins_w: Float,
    prior_hub_w: Float,
    *,
    variant: Variant = Variant.TWO_LINES,
    settings: LineFitSettings | None = None,
    down_w: Float = DOWN_W,
    reference: str = "gravity",
    stamp_s: float = 0.0,
) -> Rotor | Refusal:
    """Return the rotor of one cloud, or why there is none.

    ``points_w``: (N, 3) world ENU, metres; ``origins_w``: (N, 3) or (3,) the sensor's places;
    ``prior_hub_w``: (3,); ``down_w``: what the angle is measured from.
    """
    setting = settings or LineFitSettings()
    points, viewpoint = _near(points_w, origins_w, prior_hub_w, setting)
    if len(points) < 60:
        return Refusal(RefusalCode.NO_POINTS, f"{len(points)} points near the prior hub")
    plane = fit_rotor_plane(points, viewpoint, threshold_m=setting.plane_threshold_m)
    if plane is None:
        return Refusal(RefusalCode.NO_PLANE, "no upright plane holds the points")
    flat = _projected(points, plane, prior_hub_w, down_w, setting)
    fit = two_lines if variant is Variant.TWO_LINES else three_lines
    found = fit(flat, setting)
    if isinstance(found, Refusal):
        return found
    right, down = right_in_plane(plane.normal_w, down_w), down_in_plane(plane.normal_w, down_w)
    foot = prior_hub_w - ((prior_hub_w - plane.point_w) @ plane.normal_w) * plane.normal_w
    blades = tuple(
        Blade(name, direction_at(math.radians(angle), plane.normal_w, down_w), None)
        for name, angle in zip("ABC", blade_angles_deg(found.angle_deg), strict=True)
    )
    return Rotor(
        stamp_s=stamp_s,
        hub_w=foot + found.hub[0] * right + found.hub[1] * down,
        normal_w=plane.normal_w,
        stop_angle_deg=found.angle_deg,
        sigma_deg=max(1.0, found.spread_deg),
        reference=reference,
        blades=(blades[0], blades[1], blades[2]),
        method=variant.value,
        points=len(flat),
    )


@dataclass(frozen=True, slots=True, eq=False)
class FlatRotor:
    """A rotor in the plane: x right, y down, metres from the prior hub."""

    hub: Float
    """(2,)"""
    angle_deg: float
    """[0, 120)"""
    spread_deg: float
    """The largest difference of a line from the common angle."""


def two_lines(flat: Float, setting: LineFitSettings) -> FlatRotor | Refusal:
    """Return the rotor of one line right and one line left of the tower in (N, 2) points."""
    strip = np.abs(flat[:, 0]) < setting.tower_half_m
    kept = flat[~strip & (np.linalg.norm(flat, axis=1) > setting.hub_radius_m)]
    lines = []
    for name, side in (("right", kept[kept[:, 0] > 0]), ("left", kept[kept[:, 0] < 0])):
        line = _line(side, setting)
        if line is None:
            return Refusal(
                RefusalCode.LOW_VISIBILITY, f"no line in {len(side)} points on the {name}"
            )
        lines.append(line)
    hub = meeting_point(lines)
    if hub is None:
        return Refusal(RefusalCode.NOT_A_ROTOR, "the two lines are parallel")
    found = _common(lines, hub, weights=np.ones(2))
    if 2 * found.spread_deg > setting.max_disagreement_deg:
        text = f"right and left differ by {2 * found.spread_deg:.1f} deg modulo 120"
        return Refusal(RefusalCode.NOT_A_ROTOR, text)
    return found


def three_lines(flat: Float, setting: LineFitSettings) -> FlatRotor | Refusal:
    """Return the rotor of three lines fitted one after the other to (N, 2) points."""
    rest = flat[np.linalg.norm(flat, axis=1) > setting.hub_radius_m]
    lines: list[Line] = []
    for _ in range(3):
        line = _line(rest, setting)
        if line is None:
            code = RefusalCode.TWO_BLADES if len(lines) == 2 else RefusalCode.LOW_VISIBILITY
            return Refusal(code, f"{len(lines)} lines found, {len(rest)} points left over")
        lines.append(line)
        # Twice the threshold, so that the blade's own edges are not the next line.
        rest = rest[np.abs((rest - line.middle) @ line.normal) > 2 * setting.line_threshold_m]
    hub = meeting_point(lines)
    if hub is None:
        return Refusal(RefusalCode.NOT_A_ROTOR, "the three lines are parallel")
    weights = np.array([line.length * line.inlier.sum() for line in lines])
    found = _common(lines, hub, weights)
    if found.spread_deg > setting.max_disagreement_deg:
        text = f"a line is {found.spread_deg:.1f} deg off the common 120 deg spacing"
        return Refusal(RefusalCode.NOT_A_ROTOR, text)
    return found


def meeting_point(lines: list[Line]) -> Float | None:
    """Return the (2,) point with the least squared distance to the lines, None where parallel."""
    normals = np.stack([line.normal for line in lines])
    offsets = np.array([line.normal @ line.middle for line in lines])
    matrix = normals.T @ normals
    if float(np.linalg.eigvalsh(matrix)[0]) < 1e-3:
        return None
    point: Float = np.linalg.solve(matrix, normals.T @ offsets)
    return point


def _common(lines: list[Line], hub: Float, weights: Float) -> FlatRotor:
    """Return the angle common to lines that point from the hub to their inliers' middle."""
    rays = [
        line.direction if line.direction @ (line.middle - hub) > 0 else -line.direction
        for line in lines
    ]
    angles = np.array([math.atan2(ray[0], ray[1]) for ray in rays])
    mean = complex((weights * np.exp(3j * angles)).sum())
    angle = math.degrees(math.atan2(mean.imag, mean.real)) / 3 % 120.0
    angle = 0.0 if angle >= 120.0 else angle
    spread = max(abs(stop_angle_difference_deg(a, angle)) for a in np.degrees(angles))
    return FlatRotor(hub, angle, float(spread))


def _line(points: Float, setting: LineFitSettings) -> Line | None:
    return fit_line(
        points,
        threshold=setting.line_threshold_m,
        min_inliers=setting.min_inliers,
        min_length=setting.min_length_m,
    )


def _near(
    points_w: Float, origins_w: Float, prior_hub_w: Float, setting: LineFitSettings
) -> tuple[Float, Float]:
    """Return the points about the prior hub and the (3,) mean place of the sensor."""
    points: Float = np.asarray(points_w, np.float64).reshape(-1, 3)
    origins: Float = np.broadcast_to(np.asarray(origins_w, np.float64), points.shape)
    keep = (np.abs(points) < 1e5).all(axis=1) & (np.abs(origins) < 1e5).all(axis=1)
    points, origins = points[keep], origins[keep]
    if not len(points):
        return points, np.zeros(3)
    keep = np.linalg.norm(points - origins, axis=1) > setting.nearest_m
    keep &= np.linalg.norm(points - prior_hub_w, axis=1) < setting.reach_m
    return points[keep], origins.mean(axis=0)


def _projected(
    points: Float, plane: RotorPlane, prior_hub_w: Float, down_w: Float, setting: LineFitSettings
) -> Float:
    """Return (M, 2) points of the slab: x right, y down, metres from the prior hub."""
    off = (points - plane.point_w) @ plane.normal_w
    rel: Float = points[np.abs(off) < setting.slab_m] - prior_hub_w
    x = rel @ right_in_plane(plane.normal_w, down_w)
    y = rel @ down_in_plane(plane.normal_w, down_w)
    return np.stack([x, y], axis=1)
