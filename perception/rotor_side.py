"""On which side of its tower the rotor hangs: the plane of what stands off the tower.

Of all plumb planes round the tower's axis, leaned by the type's tilt and cone and off the axis by
about its overhang, one explains the blades: it names yaw and side together, for the plane's mirror
image lies two overhangs away. Where another explains them alike, the side is unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from config.turbine import Turbine
from perception.tower import Tower
from perception.values import Float
from perception.voxel_hash import compiled

#: Within this of the hub, nacelle and spinner outweigh the blades.
INNER_M = 6.5
MIN_BLADE_VOXELS = 40
#: Share of what stands off the tower that the rotor's plane must explain.
MIN_EXPLAINED = 0.55
#: Another yaw that explains this share of the best one's makes the side unknown.
MAX_RIVAL = 0.8
RIVAL_RAD = math.radians(30.0)
YAW_STEP_RAD = math.radians(3.0)


@dataclass(frozen=True, slots=True, eq=False)
class RotorSide:
    """Where the rotor faces, seen from the tower."""

    upwind_w: Float
    """(3,) unit, level, from the tower's axis to the rotor."""
    offset_m: float
    """Of the visible blades' plane from the axis at hub height."""
    sigma_rad: float
    blade: Float
    """(N, 3) what lies in the rotor's plane, from the tower's axis at the supposed hub height."""


def rotor_side(
    points_w: Float, tower: Tower, centre_w: Float, turbine: Turbine | None
) -> RotorSide | None:
    """Return the side of the rotor, None where the points do not tell it.

    ``points_w``: (N, 3) thinned; ``centre_w``: (3,) the tower's axis at hub height.
    """
    # Unknown types: blades reach down to about two fifths of the hub's height.
    height = float(centre_w[2] - tower.foot_w[2])
    radius = 0.6 * height if turbine is None else turbine.rotor_radius_m
    overhang = 4.0 if turbine is None else turbine.overhang_m
    offset = points_w - centre_w
    off_tower = (tower.surface_distance(points_w) > 0.8) | (offset[:, 2] > 3.0)
    reach = np.linalg.norm(offset, axis=1)
    blade = offset[off_tower & (reach > INNER_M) & (reach < radius + 3.0)]
    if len(blade) < MIN_BLADE_VOXELS:
        return None
    tilt = math.radians(5.0 if turbine is None else turbine.tilt_deg)
    cone = math.radians(2.0 if turbine is None else turbine.cone_deg)
    yaws = np.arange(0.0, 2 * math.pi, YAW_STEP_RAD)
    depths = overhang + np.arange(-1.5, 1.51, 0.5)
    some = np.linspace(0, len(blade) - 1, min(len(blade), 1500)).astype(np.int64)
    score, depth = _plane_scores(blade[some], yaws, depths, math.tan(tilt), math.tan(cone), radius)
    best = int(np.argmax(score))
    turn = np.abs((yaws - yaws[best] + math.pi) % (2 * math.pi) - math.pi)
    rival = float(score[turn > RIVAL_RAD].max())
    if rival > MAX_RIVAL * score[best]:
        return None
    return _refined(blade, float(yaws[best]), float(depth[best]), math.tan(tilt), math.tan(cone))


def _refined(blade: Float, yaw: float, depth: float, tilt: float, cone: float) -> RotorSide | None:
    """Return the side after robust least squares over yaw and offset, None where poor."""
    for width_m in (2.5, 2.0, 1.6, 1.6):
        u = np.array([math.cos(yaw), math.sin(yaw)])
        lateral = -blade[:, 0] * u[1] + blade[:, 1] * u[0]
        out = np.hypot(lateral, blade[:, 2])
        residual = blade[:, :2] @ u - (depth - tilt * blade[:, 2] + cone * out)
        weight = np.clip(1 - (residual / width_m) ** 2, 0, None) ** 2
        rows = np.stack([lateral, -np.ones_like(lateral)], axis=1)
        # The overhang is known to about a metre; yaw is free.
        normal = rows.T @ (rows * weight[:, None]) + np.diag([1e-6, 1.0])
        step = np.linalg.solve(normal, -(rows.T @ (weight * residual)))
        yaw += float(np.clip(step[0], -0.1, 0.1))
        depth += float(np.clip(step[1], -1.0, 1.0))
    inlier = np.abs(residual) < 1.6
    if int(inlier.sum()) < max(MIN_BLADE_VOXELS, MIN_EXPLAINED * len(blade)):
        return None
    # Neighbouring voxels of a chord share its offset: one independent measure in about ten.
    spread = float(np.sqrt(np.mean(residual[inlier] ** 2)))
    sigma = math.sqrt(10.0) * spread * math.sqrt(float(np.linalg.inv(normal)[0, 0]))
    upwind = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    return RotorSide(upwind, depth, sigma + math.radians(2.0), blade[inlier])


def arms_height(blade: Float, upwind_w: Float, sigma_m: float) -> tuple[float, float]:
    """Return how much higher than supposed the hub is, and the sigma of that.

    The tower's top may be hidden by the blade that hangs before it; three arms 120 deg apart still
    meet at the hub. Where they do not tell (one upright blade), nothing is changed.
    """
    lateral = -blade[:, 0] * upwind_w[1] + blade[:, 1] * upwind_w[0]
    some = np.linspace(0, len(blade) - 1, min(len(blade), 800)).astype(np.int64)
    lifts = np.arange(-10.0, 10.01, 0.5)
    score = _arm_scores(lateral[some], blade[some, 2], lifts)
    # Indifferent scores leave the height where the tower puts it.
    judged = score / max(float(score.max()), 1e-9) - 0.5 * (lifts / (10.0 + 3 * sigma_m)) ** 2
    best = int(np.argmax(judged))
    alike = lifts[judged > judged[best] - 0.1]
    return float(lifts[best]), max(1.0, 0.5 * float(alike.max() - alike.min()))


@compiled
def _arm_scores(lateral: Float, height: Float, lifts: Float) -> Float:
    """Return, for each height of the hub, how well three arms cover the points."""
    scores = np.zeros(len(lifts))
    angles = np.deg2rad(2.0 * np.arange(180))
    sines, cosines = np.sin(angles), np.cos(angles)
    for k in range(len(lifts)):
        for step in range(60):
            total = 0.0
            for n in range(len(lateral)):
                z = height[n] - lifts[k]
                nearest = 9.0
                for arm in range(3):
                    sine, cosine = sines[step + 60 * arm], cosines[step + 60 * arm]
                    along = lateral[n] * sine - z * cosine
                    if along > 0:
                        aside = abs(lateral[n] * cosine + z * sine)
                        nearest = min(nearest, aside)
                if nearest < 1.5:
                    total += 1.0 - nearest / 1.5
            scores[k] = max(scores[k], total)
    return scores


@compiled
def _plane_scores(
    blade: Float, yaws: Float, depths: Float, tilt: float, cone: float, radius: float
) -> tuple[Float, Float]:
    scores = np.zeros(len(yaws))
    best_depth = np.zeros(len(yaws))
    for a in range(len(yaws)):
        ux, uy = np.cos(yaws[a]), np.sin(yaws[a])
        for depth in depths:
            score = 0.0
            for n in range(len(blade)):
                lateral = -blade[n, 0] * uy + blade[n, 1] * ux
                out = np.hypot(lateral, blade[n, 2])
                if out < 5.0 or out > radius + 2.0:
                    continue
                stands = blade[n, 0] * ux + blade[n, 1] * uy
                residual = stands - (depth - tilt * blade[n, 2] + cone * out)
                if abs(residual) < 1.4:
                    score += 1.0 - (residual / 1.4) ** 2
            if score > scores[a]:
                scores[a] = score
                best_depth[a] = depth
    return scores, best_depth
