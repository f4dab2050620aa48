"""What the fit measures: points and edges of each blade in its own radial bins.

Blade frame: r along the blade's bearing in the rotor plane, v in the plane counter-clockwise
seen from the front, w downwind along the normal; metres from the hub.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.rotor import direction_at
from perception.values import Float

BIN_M = 0.5
EDGE_SHARE = 0.02
MIN_EDGE_POINTS = 5
KEEP_OF_WIDEST = 0.8
POINTS_PER_BIN = 12
POINT_SIGMA_M = 0.075


@dataclass(frozen=True, slots=True, eq=False)
class BladeData:
    """Rows of the fit, M of them.

    ``kind``: 0 surface point, 1 edge of least v, 2 edge of greatest v. ``view``: (M, 2) unit
    direction of sight in (v, w). ``sigma_m``: (M,) a row's standard deviation.
    """

    blade: NDArray[np.int64]
    r_m: Float
    v_m: Float
    w_m: Float
    kind: NDArray[np.int64]
    view: Float
    sigma_m: Float
    reach_m: tuple[float, float, float]
    """Outermost occupied radius of each blade."""
    counts: tuple[int, int, int]
    """Bins with points, a blade."""


def blade_axes(
    normal_w: Float, down_w: Float, angle_rad: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (3, 3) radial and (3, 3) tangential unit directions of the blades, one a row."""
    turns = [angle_rad + 2 * math.pi / 3 * k for k in range(3)]
    radial = np.stack([direction_at(t, normal_w, down_w) for t in turns])
    tangential = np.stack([direction_at(t + math.pi / 2, normal_w, down_w) for t in turns])
    return radial, tangential


def collect_blades(
    points_w: Float,
    viewpoint_w: Float,
    hub_w: Float,
    frame: tuple[Float, Float, Float],
    gate: tuple[float, float, float],
    radii: tuple[float, float],
    lines: Float | None = None,
) -> BladeData:
    """Gather the rows of all three blades.

    ``frame``: radial (3, 3), tangential (3, 3), normal (3,). ``gate``: half width across, depth
    upwind, depth downwind, metres about the axis. ``radii``: from, to. ``lines``: (3, 2) slope and
    curvature of each blade's depth, where known: the gate follows them.
    """
    radial, tangential, normal = frame
    rel, eye = points_w - hub_w, viewpoint_w - hub_w
    depth = rel @ normal
    parts: list[tuple[NDArray[np.float64], ...]] = []
    reach, bins_seen, widths = [], [], []
    for k in range(3):
        r, v = rel @ radial[k], rel @ tangential[k]
        bend = 0.0 if lines is None else lines[k, 0] * r + lines[k, 1] * r * r
        wide = gate[0] + (0.0 if lines is not None else 0.05 * np.clip(r, 0, 20))
        keep = (r > radii[0]) & (r < radii[1]) & (np.abs(v) < wide)
        keep &= (depth - bend > -gate[1]) & (depth - bend < gate[2])
        rows = _one_blade(k, r[keep], v[keep], depth[keep])
        sight = np.stack([rows[2] - eye @ tangential[k], rows[3] - eye @ normal], axis=1)
        sight /= np.linalg.norm(sight, axis=1, keepdims=True)
        parts.append((*rows, sight))
        reach.append(float(np.quantile(r[keep], 0.995)) if keep.any() else 0.0)
        bins_seen.append(len(np.unique((r[keep] / BIN_M).astype(int))))
        widths.append(_widths(rows))
    edge_ok = _visible(widths)
    columns = [np.concatenate([p[i] for p in parts]) for i in range(7)]
    blade, kind = columns[0].astype(np.int64), columns[4].astype(np.int64)
    bins = (columns[1] / BIN_M).astype(int)
    table = np.zeros((3, max(int(bins.max(initial=0)) + 1, 1)), bool)
    for (k, i), good in edge_ok.items():
        table[k, i] = good
    fine = (kind == 0) | table[blade, bins]
    return BladeData(
        blade[fine],
        columns[1][fine],
        columns[2][fine],
        columns[3][fine],
        kind[fine],
        columns[6][fine],
        columns[5][fine],
        (reach[0], reach[1], reach[2]),
        (bins_seen[0], bins_seen[1], bins_seen[2]),
    )


def _one_blade(k: int, r: Float, v: Float, w: Float) -> tuple[NDArray[np.float64], ...]:
    """Return columns blade, r, v, w, kind, sigma of one blade: thinned points, then edges."""
    order = np.argsort(r, kind="stable")
    r, v, w = r[order], v[order], w[order]
    index = (r / BIN_M).astype(int)
    starts = np.flatnonzero(np.diff(index, prepend=-1))
    ends = np.append(starts[1:], len(r))
    rows: list[NDArray[np.float64]] = []
    for a, b in zip(starts, ends, strict=True):
        n = int(b - a)
        step = max(1, -(-n // POINTS_PER_BIN))
        chosen = slice(a, b, step)
        m = len(r[chosen])
        # A bin never weighs more than four independent points: the shape errs together.
        sigma = POINT_SIGMA_M * math.sqrt(max(1.0, m / 4.0))
        block = np.empty((m, 6))
        block[:, 0], block[:, 1], block[:, 2] = k, r[chosen], v[chosen]
        block[:, 3], block[:, 4], block[:, 5] = w[chosen], 0, sigma
        rows.append(block)
        if n >= MIN_EDGE_POINTS:
            ranked = a + np.argsort(v[a:b])
            low, high = ranked[int(EDGE_SHARE * (n - 1))], ranked[-1 - int(EDGE_SHARE * (n - 1))]
            width = v[high] - v[low]
            middle = float(r[a:b].mean())
            blur = math.hypot(0.045, width / (n + 1) * 1.2)
            inset = width * (1.0 / (n + 1) + (0.04 if n > 12 else 0.0)) * 0.6
            rows.append(
                np.array(
                    [
                        [k, middle, v[low] - inset, w[low], 1, blur],
                        [k, middle, v[high] + inset, w[high], 2, blur],
                    ]
                )
            )
    table = np.concatenate(rows) if rows else np.empty((0, 6))
    return tuple(table[:, i] for i in range(6))


def _widths(rows: tuple[NDArray[np.float64], ...]) -> dict[int, float]:
    low, high = rows[4] == 1, rows[4] == 2
    widths = rows[2][high] - rows[2][low]
    return dict(zip((rows[1][low] / BIN_M).astype(int).tolist(), widths.tolist(), strict=True))


def _visible(widths: list[dict[int, float]]) -> dict[tuple[int, int], bool]:
    """Bins whose edges are the blade's own, not the border of the field of view.

    Dropped: narrower than 0.8 of the neighbouring bins' median, and the outermost seen bin. Across
    blades the comparison holds only where pitch is alike, so it is made where all agree else.
    """
    ok: dict[tuple[int, int], bool] = {}
    for k, of_blade in enumerate(widths):
        last = max(of_blade, default=0)
        for i, width in of_blade.items():
            near = sorted(of_blade[j] for j in range(i - 4, i + 3) if j in of_blade)
            ok[k, i] = i < last and width > KEEP_OF_WIDEST * near[len(near) // 2]
    return ok
