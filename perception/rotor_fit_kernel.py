"""Normal equations of the joint fit, compiled.

Each datum is compared with the nearest visible piece of its blade's section (points) or with the
section's outermost visible vertex (edges); residuals are along that piece's normal.
"""

from __future__ import annotations

import math

import numpy as np

from perception.voxel_hash import compiled

#: Order of the parameters. Hub shift right, down, along the normal; slope of depth along right and
#: down (turn of the plane); stop angle; upwind cone; prebend scale; sag at the tip, metres; pitch
#: of the three blades; then, a value at each knot of the span: chord (relative), pitch axis (share
#: of the chord), thickness (relative), twist (radians), all as differences from the table.
HX, HY, HZ, SR, SD, ANGLE, CONE, PREBEND, SAG, PITCH = range(10)
KNOTS = 7
#: Cosine of the steepest incidence at which a surface still returns.
GRAZING = 0.12
CHORD = 12
AXIS = CHORD + KNOTS
THICK = AXIS + KNOTS
TWIST = THICK + KNOTS
PARAMETERS = TWIST + KNOTS
KNOT_SPAN = np.array([0.0, 0.06, 0.12, 0.19, 0.28, 0.45, 1.0])


@compiled
def normal_equations(  # type: ignore[no-untyped-def]  # compiled; called from rotor_fit alone
    params,
    blade,
    r,
    v,
    w,
    kind,
    view,
    sigma,
    axes,
    station,
    x,
    y,
    length,
    hub_radius,
    sense,
    huber,
    reject,
    out_jtj,
    out_jtr,
    out_residual,
):
    """Accumulate J'WJ and J'Wr; return the robust cost.

    ``axes``: (3, 4), rows are (radial.right, radial.down, tangential.right, tangential.down);
    ``station``: (S, 5) chord, twist, pitch axis, prebend, bend shape. ``sense`` is 1 for rotors
    that turn clockwise seen from upwind.
    """
    out_jtj[:] = 0.0
    out_jtr[:] = 0.0
    cost = 0.0
    stations, vertices = x.shape
    index = np.zeros(PARAMETERS, np.int64)
    q = np.zeros((vertices, 2))
    row = np.zeros(PARAMETERS)
    for m in range(len(r)):
        b = blade[m]
        position = (r[m] - hub_radius) / length * (stations - 1)
        position = min(max(position, 0.0), stations - 1.001)
        i = int(position)
        f = position - i
        near = i + 1 if f > 0.5 else i
        c0 = station[i, 0] * (1 - f) + station[i + 1, 0] * f
        t0 = station[i, 1] * (1 - f) + station[i + 1, 1] * f
        x0 = station[i, 2] * (1 - f) + station[i + 1, 2] * f
        p0 = station[i, 3] * (1 - f) + station[i + 1, 3] * f
        s0 = station[i, 4] * (1 - f) + station[i + 1, 4] * f
        pitch = params[PITCH + b]
        share = position / (stations - 1)
        knot = 0
        while knot < KNOTS - 2 and share > KNOT_SPAN[knot + 1]:
            knot += 1
        h2 = (share - KNOT_SPAN[knot]) / (KNOT_SPAN[knot + 1] - KNOT_SPAN[knot])
        h1 = 1.0 - h2
        scale = 1.0 + h1 * params[CHORD + knot] + h2 * params[CHORD + knot + 1]
        chord = c0 * scale
        xa = x0 + h1 * params[AXIS + knot] + h2 * params[AXIS + knot + 1]
        fat = 1.0 + h1 * params[THICK + knot] + h2 * params[THICK + knot + 1]
        phi = pitch + t0 + h1 * params[TWIST + knot] + h2 * params[TWIST + knot + 1]
        sp, cp = math.sin(pitch), math.cos(pitch)
        s, c = math.sin(phi), math.cos(phi)
        le_v, le_w = -sense * c, -s
        ps_v, ps_w = sense * s, -c
        er_r, er_d, et_r, et_d = axes[b, 0], axes[b, 1], axes[b, 2], axes[b, 3]
        # Flatwise (pressure-side) share of the sag is the soft one; edgewise a quarter of it.
        flat = et_d * (sense * sp)
        edge = et_d * (-sense * cp)
        bend_v = s0 * (flat * (sense * sp) + 0.25 * edge * (-sense * cp))
        bend_w = s0 * (flat * (-cp) + 0.25 * edge * (-sp))
        ax_v = (
            params[HX] * et_r
            + params[HY] * et_d
            + r[m] * params[ANGLE]
            + params[PREBEND] * p0 * (sense * sp)
            + params[SAG] * bend_v
        )
        ax_w = (
            params[HZ]
            + r[m] * (params[SR] * er_r + params[SD] * er_d - params[CONE])
            - params[PREBEND] * p0 * cp
            + params[SAG] * bend_w
        )
        for k in range(vertices):
            along = (xa - x[near, k]) * chord
            up = -y[near, k] * chord * fat
            q[k, 0] = ax_v + along * le_v + up * ps_v
            q[k, 1] = ax_w + along * le_w + up * ps_w
        # The nearest visible piece.
        best, best_k, best_f = 1e18, -1, 0.0
        for k in range(vertices):
            k2 = k + 1 if k + 1 < vertices else 0
            dv, dw = q[k2, 0] - q[k, 0], q[k2, 1] - q[k, 1]
            size2 = dv * dv + dw * dw
            # Outline runs TE, suction side, LE, pressure side: its outward normal is (dw, -dv).
            facing = sense * (dw * view[m, 0] - dv * view[m, 1])
            if facing >= 0.0 or facing * facing < GRAZING * GRAZING * size2 or size2 < 1e-12:
                continue
            if kind[m] == 0:
                f2 = ((v[m] - q[k, 0]) * dv + (w[m] - q[k, 1]) * dw) / size2
                f2 = min(max(f2, 0.0), 1.0)
                e_v, e_w = v[m] - q[k, 0] - f2 * dv, w[m] - q[k, 1] - f2 * dw
                distance = e_v * e_v + e_w * e_w
                if distance < best:
                    best, best_k, best_f = distance, k, f2
            else:
                turn = -1.0 if kind[m] == 2 else 1.0
                if turn * q[k, 0] < best:
                    best, best_k, best_f = turn * q[k, 0], k, 0.0
                if turn * q[k2, 0] < best:
                    best, best_k, best_f = turn * q[k2, 0], k, 1.0
        if best_k < 0:
            out_residual[m] = math.nan
            continue
        k, k2 = best_k, (best_k + 1) % vertices
        if kind[m] != 0:
            n_v, n_w = 1.0, 0.0
        else:
            dv, dw = q[k2, 0] - q[k, 0], q[k2, 1] - q[k, 1]
            size = math.sqrt(dv * dv + dw * dw)
            n_v, n_w = sense * dw / size, -sense * dv / size
        q_v = q[k, 0] * (1 - best_f) + q[k2, 0] * best_f
        q_w = q[k, 1] * (1 - best_f) + q[k2, 1] * best_f
        if kind[m] == 0:
            # Off the end of the outline the distance is to a vertex, not to a side.
            e_v, e_w = v[m] - q_v, w[m] - q_w
            size = math.sqrt(e_v * e_v + e_w * e_w)
            if (best_f == 0.0 or best_f == 1.0) and size > 1e-4:
                turn = 1.0 if e_v * n_v + e_w * n_w >= 0 else -1.0
                n_v, n_w = turn * e_v / size, turn * e_w / size
        residual = n_v * (v[m] - q_v) + n_w * (w[m] - q_w)
        out_residual[m] = residual
        sx = x[near, k] * (1 - best_f) + x[near, k2] * best_f
        sy = y[near, k] * (1 - best_f) + y[near, k2] * best_f
        along, up = (xa - sx) * chord, -sy * chord * fat
        turned_v = along * sense * s + up * sense * c
        turned_w = -along * c + up * s
        row[:] = 0.0
        row[HX], row[HY], row[HZ] = n_v * et_r, n_v * et_d, n_w
        row[SR], row[SD] = n_w * r[m] * er_r, n_w * r[m] * er_d
        row[ANGLE], row[CONE] = n_v * r[m], -n_w * r[m]
        row[PREBEND] = p0 * (sense * sp * n_v - cp * n_w)
        row[SAG] = bend_v * n_v + bend_w * n_w
        d_chord = (n_v * (along * le_v + up * ps_v) + n_w * (along * le_w + up * ps_w)) / scale
        d_axis = chord * (n_v * le_v + n_w * le_w)
        d_fat = -sy * chord * (n_v * ps_v + n_w * ps_w)
        d_turn = n_v * turned_v + n_w * turned_w
        row[CHORD + knot], row[CHORD + knot + 1] = h1 * d_chord, h2 * d_chord
        row[AXIS + knot], row[AXIS + knot + 1] = h1 * d_axis, h2 * d_axis
        row[THICK + knot], row[THICK + knot + 1] = h1 * d_fat, h2 * d_fat
        row[TWIST + knot], row[TWIST + knot + 1] = h1 * d_turn, h2 * d_turn
        row[PITCH + b] = (
            n_v * turned_v + n_w * turned_w + params[PREBEND] * p0 * (sense * cp * n_v + sp * n_w)
        )
        z = abs(residual) / sigma[m]
        if z > reject:
            cost += huber * (2 * reject - huber)
            continue
        if z <= huber:
            weight, part = 1.0, z * z
        else:
            weight, part = huber / z, huber * (2 * z - huber)
        cost += part
        weight /= sigma[m] * sigma[m]
        used = 0
        for a in range(PARAMETERS):
            if row[a] != 0.0:
                index[used] = a
                used += 1
        for a in range(used):
            wa = weight * row[index[a]]
            out_jtr[index[a]] += wa * residual
            for d in range(a + 1):
                out_jtj[index[a], index[d]] += wa * row[index[d]]
    for a in range(PARAMETERS):
        for d in range(a):
            out_jtj[d, a] = out_jtj[a, d]
    return cost
