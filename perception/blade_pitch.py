"""Blade pitch from the sections that the LiDAR sees.

In the plane across the blade a section shows one face, or its edge. Sections of the type (or of
the generic family, scaled) are laid over the points for every pitch, twist removed: what is
measured must lie on the outline, and what should be seen of the outline must be measured. The
second half keeps the edge of a feathered blade from passing for the face of an operating one.
Pitch 0 is operating: pressure side upwind, leading edge towards the rotation; 90 is feathered,
leading edge upwind. Leading and trailing edge cannot be swapped within the range that pitch
bearings have; where two far pitches explain the points alike, none is given.
"""

from __future__ import annotations

import math

import numpy as np

from config.turbine import Turbine
from perception.blade_section import SectionTable, generic_sections, published_sections
from perception.values import Float
from perception.voxel_hash import Int64, compiled

#: Pitch bearings turn within this.
RANGE_DEG = (-12.0, 102.0)
STEP_DEG = 2.0
BIN_M = 1.0
POINTS_PER_BIN = 40
MIN_BINS = 3
#: The axis the blade is measured about is known to about this.
AXIS_SIGMA_M = 0.6
#: Another pitch this far off whose cost is within this factor of the best makes it unknown.
RIVAL_DEG = 25.0
RIVAL_COST = 1.15
GENERIC_RADIUS_M = 45.0


def estimate_blade_pitch(
    points_w: Float,
    hub_w: Float,
    normal_w: Float,
    direction_w: Float,
    turbine: Turbine | None,
    *,
    viewpoint_w: Float | None = None,
) -> tuple[float, float] | None:
    """Return (pitch_deg, sigma_deg) of one blade, None where it cannot be told.

    ``points_w``: (N, 3) world metres, of the whole rotor or one blade; ``hub_w``: (3,);
    ``normal_w``: (3,) downwind; ``direction_w``: (3,) the blade's axis from the hub;
    ``viewpoint_w``: (3,) where the points were measured from, before the hub by default.
    """
    normal = np.asarray(normal_w, np.float64)
    direction = np.asarray(direction_w, np.float64)
    towards = np.cross(normal, direction)
    if turbine is not None and turbine.rotation == "counter-clockwise":
        towards = -towards
    towards /= np.linalg.norm(towards)
    upwind = -(normal - (normal @ direction) * direction)
    upwind /= np.linalg.norm(upwind)
    frame = np.stack([direction, towards, upwind])

    table = generic_sections(GENERIC_RADIUS_M) if turbine is None else published_sections(turbine)
    binned = _binned((points_w - hub_w) @ frame.T, table)
    if binned is None:
        return None
    view = hub_w - 20.0 * normal if viewpoint_w is None else viewpoint_w
    eye = frame @ (view - hub_w)
    scales: Float = np.array([0.9, 1.0, 1.1])
    if turbine is None:
        scales = np.array([0.6, 0.75, 0.9, 1.05, 1.2, 1.35, 1.5])
    found = _judge(*binned, table, eye, scales)
    if found is None or turbine is not None:
        return found
    # A stranger's blade need not be shaped like the family.
    pitch_deg, sigma_deg = found
    return (pitch_deg, 2.0 * sigma_deg) if sigma_deg < 6.0 else None


def _binned(local: Float, table: SectionTable) -> tuple[Float, Int64, Int64] | None:
    """Return points (M, 2) across the blade, where each bin begins (B + 1,), station index (B,)."""
    radius = local[:, 0]
    across = np.hypot(local[:, 1], local[:, 2])
    span = radius - table.hub_radius_m
    low, high = 0.10 * table.length_m, 0.75 * table.length_m
    widest = 0.8 * float(table.chord_m.max()) + 1.0
    keep = np.isfinite(local).all(axis=1) & (span > low) & (span < high) & (across < widest)
    # Nearer another blade's axis than this one's is not this blade.
    keep &= across < 0.8 * radius
    local, span = local[keep], span[keep]
    bins = np.floor(span / BIN_M).astype(np.int64)
    points, begins, stations = [], [0], []
    for one in np.unique(bins):
        inside = local[bins == one, 1:]
        if len(inside) < 8:
            continue
        # Thinned evenly; order in a scan is by time, so this is as good as random.
        some = inside[np.linspace(0, len(inside) - 1, min(len(inside), POINTS_PER_BIN)).astype(int)]
        share = (one + 0.5) * BIN_M / table.length_m
        points.append(some)
        begins.append(begins[-1] + len(some))
        stations.append(round(share * (len(table.chord_m) - 1)))
    if len(stations) < MIN_BINS:
        return None
    bend = table.prebend_m[np.array(stations)]
    shifted = [some - (0.0, b) for some, b in zip(points, bend, strict=True)]
    return np.concatenate(shifted), np.array(begins), np.array(stations)


def _judge(
    points: Float,
    begins: Int64,
    stations: Int64,
    table: SectionTable,
    eye: Float,
    scales: Float,
) -> tuple[float, float] | None:
    """Return the pitch of least cost and how sharp it is."""
    pitches = np.arange(RANGE_DEG[0], RANGE_DEG[1] + 0.1, STEP_DEG)
    costs = np.array(
        [
            min(
                _cost(
                    points, begins, stations, table.x, table.y, table.chord_m * scale,
                    table.twist_rad, table.pitch_axis, table.length_m, table.hub_radius_m, eye,
                    math.radians(pitch), AXIS_SIGMA_M,
                )
                for scale in scales
            )
            for pitch in pitches
        ]
    )  # fmt: skip
    best = int(np.argmin(costs))
    rivals = costs[np.abs(pitches - pitches[best]) > RIVAL_DEG]
    if rivals.size and float(rivals.min()) < RIVAL_COST * costs[best]:
        return None
    pitch = float(pitches[best])
    if 0 < best < len(pitches) - 1:
        left, top, right = costs[best - 1], costs[best], costs[best + 1]
        bend = left - 2 * top + right
        if bend > 1e-9:
            pitch += float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) * STEP_DEG
    alike = pitches[costs < 1.1 * costs[best]]
    sigma = max(3.0, 0.5 * float(alike.max() - alike.min()))
    return (pitch, sigma) if sigma < 15.0 else None


@compiled
def _cost(
    points: Float, begins: Int64, stations: Int64, xs: Float, ys: Float, chord: Float,
    twist: Float, axis: Float, length: float, hub_radius: float, eye: Float, pitch: float,
    axis_sigma: float,
) -> float:  # fmt: skip
    """Return the mean distance between points and visible outlines, after the best common shift."""
    vertices = xs.shape[1]
    shift = np.zeros(2)
    cost = 0.0
    outline = np.empty((vertices, 2))
    visible = np.empty(vertices, np.bool_)
    for turn in range(4):
        pull = np.zeros(2)
        pulls = 0.0
        cost = 0.0
        weights = 0.0
        for b in range(len(stations)):
            s = stations[b]
            radius = hub_radius + s / (len(chord) - 1) * length
            angle = pitch + twist[s]
            cosine, sine = np.cos(angle), np.sin(angle)
            for v in range(vertices):
                along = (axis[s] - xs[s, v]) * chord[s]
                out = -ys[s, v] * chord[s]
                # Leading edge (cos, sin), pressure side (-sin, cos) in (rotation, upwind).
                outline[v, 0] = along * cosine - out * sine + shift[0]
                outline[v, 1] = along * sine + out * cosine + shift[1]
            for v in range(vertices):
                w = (v + 1) % vertices
                u = v - 1 if v > 0 else vertices - 1
                # Outward normal of the counter- or clockwise outline: away from the middle.
                nx = outline[w, 1] - outline[u, 1]
                ny = outline[u, 0] - outline[w, 0]
                mx = outline[v, 0] - (shift[0] + (axis[s] - 0.5) * chord[s] * cosine)
                my = outline[v, 1] - (shift[1] + (axis[s] - 0.5) * chord[s] * sine)
                if nx * mx + ny * my < 0:
                    nx, ny = -nx, -ny
                ex, ey, er = eye[1] - outline[v, 0], eye[2] - outline[v, 1], eye[0] - radius
                size = np.sqrt(ex * ex + ey * ey + er * er)
                visible[v] = nx * ex + ny * ey > 0.15 * size * np.sqrt(nx * nx + ny * ny)
            for n in range(begins[b], begins[b + 1]):
                best, bx, by = 1e9, 0.0, 0.0
                for v in range(vertices):
                    w = (v + 1) % vertices
                    if not (visible[v] or visible[w]):
                        continue
                    ax, ay = outline[w, 0] - outline[v, 0], outline[w, 1] - outline[v, 1]
                    px, py = points[n, 0] - outline[v, 0], points[n, 1] - outline[v, 1]
                    t = (px * ax + py * ay) / max(ax * ax + ay * ay, 1e-12)
                    t = min(max(t, 0.0), 1.0)
                    dx, dy = px - t * ax, py - t * ay
                    d2 = dx * dx + dy * dy
                    if d2 < best:
                        best, bx, by = d2, dx, dy
                d = np.sqrt(best)
                weight = 1.0 / (1.0 + (d / 0.5) ** 2) / (begins[b + 1] - begins[b])
                pull[0] += weight * bx
                pull[1] += weight * by
                pulls += weight
                cost += min(d, 1.0) / (begins[b + 1] - begins[b])
            seen = 0
            missed = 0.0
            for v in range(vertices):
                if not visible[v]:
                    continue
                best = 1e9
                for n in range(begins[b], begins[b + 1]):
                    dx, dy = points[n, 0] - outline[v, 0], points[n, 1] - outline[v, 1]
                    best = min(best, dx * dx + dy * dy)
                seen += 1
                missed += min(np.sqrt(best), 1.0)
            if seen > 0:
                cost += missed / seen
            weights += 1.0
        if turn < 3:
            shift[0] += pull[0] / max(pulls, 1e-9)
            shift[1] += pull[1] / max(pulls, 1e-9)
    reach = (shift[0] ** 2 + shift[1] ** 2) / (axis_sigma * axis_sigma)
    return float(cost / weights + 0.02 + 0.03 * reach)
