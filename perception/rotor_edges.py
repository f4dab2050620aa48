"""What the fit measures: points and edges of each blade in its own radial bins.

Blade frame: r along the blade's bearing in the rotor plane, v in the plane counter-clockwise
seen from the front, w downwind along the normal; metres from the hub.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.rotor import down_in_plane, right_in_plane
from perception.rotor_fit_kernel import Rows
from perception.values import Float
from perception.voxel_hash import compiled

BIN_M = 0.5
"""Radial bins; a first look may take wider ones."""
EDGE_SHARE = 0.02
MIN_EDGE_POINTS = 5
KEEP_OF_WIDEST = 0.8
POINTS_PER_BIN = 7
POINT_SIGMA_M = 0.075
EDGE_SIGMA_M = 0.045
#: A metre never weighs more than this many independent points: the shape errs together.
WORTH = 8.0
REACH_SHARE = 0.005
"""Of a blade's points may lie beyond what is called its reach."""


@dataclass(frozen=True, slots=True, eq=False)
class BladeData:
    """Rows of the fit and what they say of the blades.

    ``rows.kind``: 0 surface point, 1 edge of least v, 2 edge of greatest v. ``rows.sight``: (M, 2)
    share across the blade, (v, w), of the unit direction of sight. ``rows.sigma_m``: (M,).
    """

    rows: Rows
    reach_m: tuple[float, float, float]
    """Outermost occupied radius of each blade."""
    seen_m: tuple[float, float, float]
    """Length of each blade in bins with points."""


def blade_axes(
    normal_w: Float, down_w: Float, angle_rad: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (3, 3) radial and (3, 3) tangential unit directions of the blades, one a row."""
    turns = angle_rad + 2 * math.pi / 3 * np.arange(3)
    frame = np.stack([down_in_plane(normal_w, down_w), right_in_plane(normal_w, down_w)])
    cosine, sine = np.cos(turns), np.sin(turns)
    return np.stack([cosine, sine], axis=1) @ frame, np.stack([-sine, cosine], axis=1) @ frame


def collect_blades(
    points_w: Float,
    viewpoint_w: Float,
    hub_w: Float,
    frame: tuple[Float, Float, Float],
    gate: tuple[float, float, float],
    radii: tuple[float, float],
    slope: float | None = None,
    bin_m: float = BIN_M,
) -> BladeData:
    """Gather the rows of all three blades.

    ``frame``: radial (3, 3), tangential (3, 3), normal (3,). ``gate``: half width across, depth
    upwind, depth downwind, metres about the axis. ``radii``: from, to. ``slope``: of the blades'
    depth along the radius, where known: the gate follows it, and no longer widens outward.
    """
    radial, tangential, normal = frame
    bins = int(radii[1] / bin_m) + 2
    most = 3 * bins * (POINTS_PER_BIN + 2)
    table, kind = np.empty((most, 8)), np.empty(most, np.int64)
    reach, seen = np.zeros(3), np.zeros(3)
    used = 0
    room = np.empty((len(points_w), 3))
    for k in range(3):
        axes = np.stack([radial[k], tangential[k], normal])
        shape = np.array([*gate, *radii, slope or 0.0, 1.0 if slope is None else 0.0])
        kept = room[: _inside(points_w, hub_w, axes, shape, room)]
        n, filled = _rows_of(
            kept, axes @ (viewpoint_w - hub_w), k, (bin_m, bins), table[used:], kind[used:]
        )
        used += n
        seen[k] = bin_m * filled
        if len(kept):
            outer = len(kept) - 1 - int(REACH_SHARE * (len(kept) - 1))
            reach[k] = np.partition(kept[:, 0], outer)[outer]
    column = [np.ascontiguousarray(table[:used, c]) for c in range(8)]
    rows = Rows(
        column[0].astype(np.int64), column[1], column[2], column[3], kind[:used],
        np.ascontiguousarray(table[:used, 5:7]), column[4], column[7],
    )  # fmt: skip
    return BladeData(
        rows,
        (float(reach[0]), float(reach[1]), float(reach[2])),
        (float(seen[0]), float(seen[1]), float(seen[2])),
    )


@compiled
def _inside(points: Float, hub: Float, axes: Float, shape: Float, out: Float) -> int:
    """Write r, v, w of the points (N, 3) that belong to the blade; return how many.

    ``axes``: (3, 3) rows radial, tangential, normal; ``shape``: gate, radii, slope of the depth,
    whether the gate widens.
    """
    side, up, behind, first, last, slope, widening = shape
    used = 0
    for n in range(len(points)):
        x, y, z = points[n, 0] - hub[0], points[n, 1] - hub[1], points[n, 2] - hub[2]
        r = x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2]
        if r <= first or r >= last:
            continue
        v = x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2]
        if abs(v) >= side + widening * 0.05 * min(r, 20.0):
            continue
        w = x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2]
        if -up < w - slope * r < behind:
            out[used, 0], out[used, 1], out[used, 2] = r, v, w
            used += 1
    return used


@compiled
def _rows_of(
    local: Float,
    eye: Float,
    blade: int,
    binning: tuple[float, int],
    table: Float,
    kind: NDArray[np.int64],
) -> tuple[int, int]:
    """Write the rows of one blade, bin by bin: thinned points, then edges.

    Returns how many rows, and how many bins hold points.

    ``binning``: width of the bins, metres, and their number.

    ``table`` columns: blade, r, v, w, sigma, sight along v, sight along w,
    middle of the bin.
    """
    bin_m, bins = binning
    order, starts = _sorted_by_bin(local, bin_m, bins)
    low_row = np.full(bins, -1)
    width = np.zeros(bins)
    last, used, filled = 0, 0, 0
    for i in range(bins):
        a, b = starts[i], starts[i + 1]
        n = b - a
        if n == 0:
            continue
        filled += 1
        step = max(1, -(-n // POINTS_PER_BIN))
        m = -(-n // step)
        sigma = POINT_SIGMA_M * math.sqrt(max(1.0, m / (WORTH * bin_m)))
        middle = local[order[a:b], 0].mean()
        for j in range(a, b):
            if (j - a) % step == 0:
                _write(table, used, blade, local[order[j]], sigma, eye, middle)
                kind[used] = 0
                used += 1
        if n < MIN_EDGE_POINTS:
            continue
        some = order[a:b]
        ranked = some[np.argsort(local[some, 1])]
        skip = int(EDGE_SHARE * (n - 1))
        low, high = local[ranked[skip]].copy(), local[ranked[n - 1 - skip]].copy()
        width[i] = high[1] - low[1]
        # Pulses do not fall on the edge itself; beyond it they are lost or mixed.
        blur = math.hypot(EDGE_SIGMA_M, width[i] / (n + 1) * 1.2)
        inset = width[i] * (1.0 / (n + 1) + (0.04 if n > 12 else 0.0)) * 0.6
        low[0], high[0] = middle, middle
        low[1] -= inset
        high[1] += inset
        low_row[i], last = used, i
        _write(table, used, blade, low, blur, eye, middle)
        _write(table, used + 1, blade, high, blur, eye, middle)
        kind[used], kind[used + 1] = 1, 2
        used += 2
    kept: int = _without_borders(table, kind, used, low_row, width, last)
    return kept, filled


@compiled
def _sorted_by_bin(  # type: ignore[no-untyped-def]  # compiled
    local, bin_m, bins
):
    """Return the order of points by radial bin, theirs kept within, and where each bin starts."""
    starts = np.zeros(bins + 1, np.int64)
    for n in range(len(local)):
        starts[int(local[n, 0] / bin_m) + 1] += 1
    for i in range(bins):
        starts[i + 1] += starts[i]
    at = starts[:-1].copy()
    order = np.empty(len(local), np.int64)
    for n in range(len(local)):
        i = int(local[n, 0] / bin_m)
        order[at[i]] = n
        at[i] += 1
    return order, starts


@compiled
def _write(  # type: ignore[no-untyped-def]  # compiled
    table, at, blade, point, sigma, eye, middle
):
    table[at, 0], table[at, 1], table[at, 2], table[at, 3] = blade, point[0], point[1], point[2]
    d_r, d_v, d_w = point[0] - eye[0], point[1] - eye[1], point[2] - eye[2]
    size = math.sqrt(d_r * d_r + d_v * d_v + d_w * d_w)
    table[at, 4], table[at, 5], table[at, 6] = sigma, d_v / size, d_w / size
    table[at, 7] = middle


@compiled
def _without_borders(  # type: ignore[no-untyped-def]  # compiled
    table, kind, used, low_row, width, last
):
    """Drop edges that are the border of the field of view rather than the blade's own.

    Dropped: narrower than 0.8 of the neighbouring bins' median, and the outermost seen bin.
    """
    drop = np.zeros(used, np.bool_)
    near = np.zeros(7)
    for i in range(len(low_row)):
        if low_row[i] < 0:
            continue
        count = 0
        for j in range(max(i - 4, 0), min(i + 3, len(low_row))):
            if low_row[j] >= 0:
                near[count] = width[j]
                count += 1
        middle = np.sort(near[:count])[count // 2]
        if i >= last or width[i] <= KEEP_OF_WIDEST * middle:
            drop[low_row[i]] = True
            drop[low_row[i] + 1] = True
    kept = 0
    for m in range(used):
        if not drop[m]:
            table[kept] = table[m]
            kind[kept] = kind[m]
            kept += 1
    return kept
