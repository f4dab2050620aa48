"""The joint fit, compiled: normal equations of points and edges, and the robust iteration on them.

Each datum is compared with the nearest visible piece of its blade's section (points) or with the
section's outermost visible vertex (edges); residuals are along that piece's normal. The rows of one
section share its six local motions (across, along the normal, turn, chord, pitch axis, thickness),
so they are summed locally and spread to the rotor's parameters once a section.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from perception.values import Float

if TYPE_CHECKING:
    from collections.abc import Callable


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile as `voxel_hash.compiled` does, sums reordered for speed; NaN keeps its meaning."""
    flags = {"contract", "reassoc", "arcp", "nsz"}
    wrapped: Callable[..., Any] = numba.njit(cache=True, nogil=True, fastmath=flags)(function)
    return wrapped


#: Order of the parameters. Hub shift right, down, along the normal; slope of depth along right and
#: down (turn of the plane); stop angle; upwind cone; two amplitudes of prebend; sag at the tip,
#: metres; pitch of the three blades; what each bearing stands off an even 120 deg; then, a value at
#: each knot of the span: chord (relative), pitch axis (share of the chord), thickness (relative),
#: twist (radians), all as differences from the table.
HX, HY, HZ, SR, SD, ANGLE, CONE, PREBEND, BEND, SAG, PITCH = range(11)
SPACING = PITCH + 3
CHORD = SPACING + 3
KNOTS = 7
AXIS = CHORD + KNOTS
THICK = AXIS + KNOTS
TWIST = THICK + KNOTS
PARAMETERS = TWIST + KNOTS
KNOT_SPAN = np.array([0.0, 0.06, 0.12, 0.19, 0.28, 0.45, 1.0])
#: Cosine of the steepest incidence at which a surface still returns.
GRAZING = 0.12
#: A blade sags edgewise by this share of what it would flatwise.
EDGE_SHARE = 0.25
#: Parameters that move one section.
TOUCHED = 20
HUBER = 1.5
#: Blades whose pitches differ by more than this are not held together, at a fixed cost.
APART_RAD = math.radians(20.0)
APART_COST = 25.0


class Rows(NamedTuple):
    """Data of the fit, M rows grouped by section; see `rotor_edges.BladeData`."""

    blade: NDArray[np.int64]
    r_m: Float
    v_m: Float
    w_m: Float
    kind: NDArray[np.int64]
    sight: Float
    sigma_m: Float
    middle_m: Float


class Shape(NamedTuple):
    """What the rows are compared with.

    ``axes``: (3, 4), rows are (radial.right, radial.down, tangential.right, tangential.down);
    ``station``: (S, 6) chord, twist, pitch axis, two prebend shapes, sag shape; ``x``, ``y``:
    (S, V) outlines in chords. ``sense`` is 1 for rotors that turn clockwise seen from upwind.
    """

    axes: Float
    station: Float
    x: Float
    y: Float
    length_m: float
    hub_radius_m: float
    sense: float


class Prior(NamedTuple):
    """Mean (P,), information (P, P), and information on the difference of two blades' pitches."""

    mean: Float
    info: Float
    pitch_info: float


@compiled
def _knot(share: float) -> tuple[int, float]:
    """Return the knot below a share of the span and the weight of the next."""
    knot = 0
    while knot < KNOTS - 2 and share > KNOT_SPAN[knot + 1]:
        knot += 1
    return knot, (share - KNOT_SPAN[knot]) / (KNOT_SPAN[knot + 1] - KNOT_SPAN[knot])


@compiled
def _place(params, b, i, shape, q, local, touched, spread):  # type: ignore[no-untyped-def]  # compiled
    """Place the section of blade ``b`` at station ``i``.

    Fills its outline ``q`` (V, 2), ``local`` (to_le_v, to_le_w, to_ps_v, to_ps_w, chord, axis,
    thickness scale, chord scale), the parameters that move it ``touched`` (TOUCHED,) and how:
    ``spread`` (6, TOUCHED). Returns the station's radius and the slopes of v and w along it.
    """
    sense = shape.sense
    share = i / (len(shape.station) - 1.0)
    r = shape.hub_radius_m + share * shape.length_m
    knot, h2 = _knot(share)
    h1 = 1.0 - h2
    c0, t0, x0 = shape.station[i, 0], shape.station[i, 1], shape.station[i, 2]
    p1, p2, s0 = shape.station[i, 3], shape.station[i, 4], shape.station[i, 5]
    scale = 1.0 + h1 * params[CHORD + knot] + h2 * params[CHORD + knot + 1]
    chord = c0 * scale
    xa = x0 + h1 * params[AXIS + knot] + h2 * params[AXIS + knot + 1]
    fat = 1.0 + h1 * params[THICK + knot] + h2 * params[THICK + knot + 1]
    pitch = params[PITCH + b]
    phi = pitch + t0 + h1 * params[TWIST + knot] + h2 * params[TWIST + knot + 1]
    sp, cp = math.sin(pitch), math.cos(pitch)
    s, c = math.sin(phi), math.cos(phi)
    le_v, le_w, ps_v, ps_w = -sense * c, -s, sense * s, -c
    er_r, er_d = shape.axes[b, 0], shape.axes[b, 1]
    et_r, et_d = shape.axes[b, 2], shape.axes[b, 3]
    # Flatwise (pressure-side) share of the sag is the soft one.
    flat, edge = et_d * sense * sp, -et_d * sense * cp
    bend_v = s0 * (flat * (sense * sp) + EDGE_SHARE * edge * (-sense * cp))
    bend_w = s0 * (flat * (-cp) + EDGE_SHARE * edge * (-sp))
    pre = params[PREBEND] * p1 + params[BEND] * p2
    turn = params[ANGLE] + params[SPACING + b]
    slope = params[SR] * er_r + params[SD] * er_d - params[CONE]
    ax_v = params[HX] * et_r + params[HY] * et_d + r * turn + pre * sense * sp
    ax_v += params[SAG] * bend_v
    ax_w = params[HZ] + r * slope - pre * cp + params[SAG] * bend_w
    for k in range(shape.x.shape[1]):
        along = (xa - shape.x[i, k]) * chord
        up = -shape.y[i, k] * chord * fat
        q[k, 0] = ax_v + along * le_v + up * ps_v
        q[k, 1] = ax_w + along * le_w + up * ps_w
    local[0], local[1], local[2], local[3] = le_v, le_w, ps_v, ps_w
    local[4], local[5], local[6], local[7] = chord, xa, fat, scale
    for j in range(PITCH):
        touched[j] = j
    touched[10], touched[11] = PITCH + b, SPACING + b
    spread[0, 0], spread[0, 1], spread[1, 2] = et_r, et_d, 1.0
    spread[1, 3], spread[1, 4], spread[0, 5], spread[1, 6] = r * er_r, r * er_d, r, -r
    spread[0, 7], spread[1, 7] = p1 * sense * sp, -p1 * cp
    spread[0, 8], spread[1, 8] = p2 * sense * sp, -p2 * cp
    spread[0, 9], spread[1, 9] = bend_v, bend_w
    spread[0, 10], spread[1, 10], spread[5, 10] = pre * sense * cp, pre * sp, 1.0
    spread[0, 11] = r
    for j in range(4):
        first = CHORD + j * KNOTS + knot
        touched[12 + 2 * j], touched[13 + 2 * j] = first, first + 1
        spread[2 + j, 12 + 2 * j], spread[2 + j, 13 + 2 * j] = h1, h2
    return r, turn, slope


@compiled
def _seen_pieces(q, view_v, view_w, sense, pieces, which):  # type: ignore[no-untyped-def]  # compiled
    """List the pieces of an outline ``q`` (V, 2) that a direction of sight meets; how many.

    ``pieces``: (V, 6) start, run, one over the length squared and the length of each; ``which``:
    (V,) its index in the outline.
    """
    vertices, seen = len(q), 0
    for k in range(vertices):
        k2 = k + 1 if k + 1 < vertices else 0
        dv, dw = q[k2, 0] - q[k, 0], q[k2, 1] - q[k, 1]
        # Outline runs TE, suction side, LE, pressure side: its outward normal is (dw, -dv).
        facing = sense * (dw * view_v - dv * view_w)
        size2 = dv * dv + dw * dw
        steep = facing * facing < GRAZING * GRAZING * size2
        if facing >= 0.0 or steep or size2 < 1e-12:
            continue
        pieces[seen, 0], pieces[seen, 1], pieces[seen, 2], pieces[seen, 3] = (
            q[k, 0], q[k, 1], dv, dw
        )  # fmt: skip
        pieces[seen, 4], pieces[seen, 5] = 1.0 / size2, math.sqrt(size2)
        which[seen] = k
        seen += 1
    return seen


@compiled
def _nearest(pieces, seen, v, w):  # type: ignore[no-untyped-def]  # compiled
    """Return which of the seen pieces is nearest to a point, and the place on it."""
    best, best_n, best_f = 1e18, 0, 0.0
    for n in range(seen):
        dv, dw = pieces[n, 2], pieces[n, 3]
        e_v, e_w = v - pieces[n, 0], w - pieces[n, 1]
        f = min(max((e_v * dv + e_w * dw) * pieces[n, 4], 0.0), 1.0)
        e_v -= f * dv
        e_w -= f * dw
        distance = e_v * e_v + e_w * e_w
        if distance < best:
            best, best_n, best_f = distance, n, f
    return best_n, best_f


@compiled
def _outermost(pieces, seen, turn):  # type: ignore[no-untyped-def]  # compiled
    """Return the piece and end of it of least ``turn`` times v."""
    best, best_n, best_f = 1e18, 0, 0.0
    for n in range(seen):
        start = turn * pieces[n, 0]
        end = start + turn * pieces[n, 2]
        if start < best:
            best, best_n, best_f = start, n, 0.0
        if end < best:
            best, best_n, best_f = end, n, 1.0
    return best_n, best_f


#: Which local motion moves by which of the touched parameters: what `_place` fills of ``spread``.
_FILLED = np.array(
    [(0, 0), (0, 1), (1, 2), (1, 3), (1, 4), (0, 5), (1, 6), (0, 7), (1, 7), (0, 8), (1, 8),
     (0, 9), (1, 9), (0, 10), (1, 10), (5, 10), (0, 11), (2, 12), (2, 13), (3, 14), (3, 15),
     (4, 16), (4, 17), (5, 18), (5, 19)]
)  # fmt: skip
_FILLED_RIGID = 17
"""Of them, those that do not change the sections' shape."""


@compiled
def _flush(block, pull, touched, spread, half, rigid, jtj, jtr):  # type: ignore[no-untyped-def]  # compiled
    """Spread one section's local sums (6, 6), (6,) to the lower half of the rotor's parameters."""
    filled = _FILLED_RIGID if rigid else len(_FILLED)
    half[:] = 0.0
    for n in range(filled):
        k, j = _FILLED[n, 0], _FILLED[n, 1]
        share = spread[k, j]
        for a in range(6):
            half[a, j] += (block[a, k] if a >= k else block[k, a]) * share
    for n in range(filled):
        a, i = _FILLED[n, 0], _FILLED[n, 1]
        share, into = spread[a, i], touched[i]
        jtr[into] += share * pull[a]
        for j in range(i + 1):
            jtj[into, touched[j]] += share * half[a, j]


@compiled
def normal_equations(params, rows, shape, reject, every, rigid, jtj, jtr, residual_out):  # type: ignore[no-untyped-def]  # compiled
    """Accumulate J'WJ (P, P) and J'Wr (P,) of every ``every``-th row; return the robust cost.

    ``reject``: rows further off than this many sigmas are let go at a fixed cost. ``rigid``: leave
    out what changes the sections' shape. ``residual_out``: (M,) metres, NaN where no piece of the
    section is visible.
    """
    jtj[:] = 0.0
    jtr[:] = 0.0
    cost = 0.0
    stations, vertices = shape.x.shape
    q, local = np.zeros((vertices, 2)), np.zeros(8)
    pieces, which = np.zeros((vertices, 6)), np.zeros(vertices, np.int64)
    touched, spread = np.zeros(TOUCHED, np.int64), np.zeros((6, TOUCHED))
    block, pull, row = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    half = np.zeros((6, TOUCHED))
    count, seen, i = len(rows.r_m), 0, 0
    at_blade, at_middle = -1, -1.0
    r0, turn, slope = 0.0, 0.0, 0.0
    for m in range(0, count, every):
        b = rows.blade[m]
        if b != at_blade or rows.middle_m[m] != at_middle:
            if at_blade >= 0:
                _flush(block, pull, touched, spread, half, rigid, jtj, jtr)
            block[:] = 0.0
            pull[:] = 0.0
            at_blade, at_middle = b, rows.middle_m[m]
            share = (at_middle - shape.hub_radius_m) / shape.length_m
            i = int(min(max(share, 0.0), 1.0) * (stations - 1) + 0.5)
            r0, turn, slope = _place(params, b, i, shape, q, local, touched, spread)
            # A section is small: one direction of sight is that of all its rows.
            view_v, view_w, n = 0.0, 0.0, m
            while n < count and rows.blade[n] == b and rows.middle_m[n] == at_middle:
                view_v += rows.sight[n, 0]
                view_w += rows.sight[n, 1]
                n += 1
            seen = _seen_pieces(q, view_v / (n - m), view_w / (n - m), shape.sense, pieces, which)
        if seen == 0:
            residual_out[m] = math.nan
            continue
        off, kind = rows.r_m[m] - r0, rows.kind[m]
        v, w = rows.v_m[m] - off * turn, rows.w_m[m] - off * slope
        if kind == 0:
            at, f = _nearest(pieces, seen, v, w)
        else:
            at, f = _outermost(pieces, seen, -1.0 if kind == 2 else 1.0)
        k = which[at]
        k2 = k + 1 if k + 1 < vertices else 0
        e_v = v - pieces[at, 0] - f * pieces[at, 2]
        e_w = w - pieces[at, 1] - f * pieces[at, 3]
        n_v, n_w = 1.0, 0.0
        if kind == 0:
            size = pieces[at, 5]
            n_v, n_w = shape.sense * pieces[at, 3] / size, -shape.sense * pieces[at, 2] / size
            # Off the end of the outline the distance is to a vertex, not to a side.
            if f == 0.0 or f == 1.0:
                size = math.sqrt(e_v * e_v + e_w * e_w)
                if size > 1e-4:
                    side = 1.0 if e_v * n_v + e_w * n_w >= 0 else -1.0
                    n_v, n_w = side * e_v / size, side * e_w / size
        residual = n_v * e_v + n_w * e_w
        residual_out[m] = residual
        z = abs(residual) / rows.sigma_m[m]
        if z > reject:
            cost += HUBER * (2 * reject - HUBER)
            continue
        weight = 1.0 if z <= HUBER else HUBER / z
        cost += z * z if z <= HUBER else HUBER * (2 * z - HUBER)
        weight /= rows.sigma_m[m] * rows.sigma_m[m]
        sx = shape.x[i, k] * (1 - f) + shape.x[i, k2] * f
        sy = shape.y[i, k] * (1 - f) + shape.y[i, k2] * f
        n_le, n_ps = n_v * local[0] + n_w * local[1], n_v * local[2] + n_w * local[3]
        along, up = (local[5] - sx) * local[4], -sy * local[4] * local[6]
        row[0], row[1] = n_v, n_w
        row[2] = (along * n_le + up * n_ps) / local[7]
        row[3] = local[4] * n_le
        row[4] = -sy * local[4] * n_ps
        # A turn carries the leading edge towards the pressure side.
        row[5] = along * n_ps - up * n_le
        for a in range(6):
            wa = weight * row[a]
            pull[a] += wa * residual
            for d in range(a + 1):
                block[a, d] += wa * row[d]
    if at_blade >= 0:
        _flush(block, pull, touched, spread, half, rigid, jtj, jtr)
    for a in range(PARAMETERS):
        for d in range(a):
            jtj[d, a] = jtj[a, d]
    return cost


@compiled
def _couple(params, info, jtj, jtr):  # type: ignore[no-untyped-def]  # compiled
    """Add what binds the pitches of the blades to each other; return its share of the cost."""
    cost = 0.0
    for a in range(3):
        i, j = PITCH + a, PITCH + (a + 1) % 3
        gap = params[i] - params[j]
        if abs(gap) > APART_RAD:
            cost += APART_COST
            continue
        cost += min(gap * gap * info, APART_COST)
        jtj[i, i] += info
        jtj[j, j] += info
        jtj[i, j] -= info
        jtj[j, i] -= info
        jtr[i] -= gap * info
        jtr[j] += gap * info
    return cost


@compiled
def system(params, rows, shape, prior, reject, every, rigid, jtj, jtr, residual_out):  # type: ignore[no-untyped-def]  # compiled
    """Accumulate the whole system, priors included; return the cost."""
    cost = normal_equations(params, rows, shape, reject, every, rigid, jtj, jtr, residual_out)
    cost += _couple(params, prior.pitch_info, jtj, jtr)
    off = params - prior.mean
    pulled = prior.info @ off
    jtj += prior.info
    jtr -= pulled
    return cost + off @ pulled


@compiled
def _solved(matrix, value, size):  # type: ignore[no-untyped-def]  # compiled
    """Return the solution of a positive definite system of ``size``, by Cholesky in place."""
    for a in range(size):
        for d in range(a + 1):
            total = matrix[a, d]
            for k in range(d):
                total -= matrix[a, k] * matrix[d, k]
            if a == d:
                matrix[a, a] = math.sqrt(max(total, 1e-12))
            else:
                matrix[a, d] = total / matrix[d, d]
    out = np.zeros(len(value))
    for a in range(size):
        total = value[a]
        for k in range(a):
            total -= matrix[a, k] * out[k]
        out[a] = total / matrix[a, a]
    for a in range(size - 1, -1, -1):
        total = out[a]
        for k in range(a + 1, size):
            total -= matrix[k, a] * out[k]
        out[a] = total / matrix[a, a]
    return out


@compiled
def settle(params, rows, shape, prior, held, iterations, reject, every, rigid):  # type: ignore[no-untyped-def]  # compiled
    """Iterate ``params`` in place (Levenberg-Marquardt); return the least cost found.

    ``held``: (P,) additional stiffness (large: not moved); ``rigid``: the sections' shape is not
    moved at all.
    """
    jtj, jtr = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS)
    residual = np.zeros(len(rows.r_m))
    size = CHORD if rigid else PARAMETERS
    cost = system(params, rows, shape, prior, reject, every, rigid, jtj, jtr, residual)
    damping = 1e-3
    for _ in range(iterations):
        damped = jtj.copy()
        for k in range(size):
            damped[k, k] += held[k] + 1e-9 + damping * jtj[k, k]
        step = _solved(damped, jtr, size)
        before = params.copy()
        settled = True
        for k in range(size):
            limit = 1.0 if k < SR or k == SAG else 0.3
            step[k] = min(max(step[k], -limit), limit)
            params[k] += step[k]
            if CHORD <= k < AXIS:
                params[k] = min(max(params[k], -0.4), 0.5)
            elif THICK <= k < TWIST:
                params[k] = min(max(params[k], -0.5), 0.7)
            quiet = 5e-3 if PITCH <= k < SPACING else 3e-4 if k < PREBEND else 1.0
            settled = settled and abs(step[k]) < quiet
        if settled:
            break
        after = system(params, rows, shape, prior, reject, every, rigid, jtj, jtr, residual)
        if after <= cost:
            cost, damping = after, max(0.2 * damping, 1e-6)
            continue
        # What is visible changes with the pitch: a step may well go uphill, and is taken back.
        params[:] = before
        damping = min(max(10.0 * damping, 1e-2), 1e3)
        cost = system(params, rows, shape, prior, reject, every, rigid, jtj, jtr, residual)
    return cost
