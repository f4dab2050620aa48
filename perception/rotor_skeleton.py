"""A coarse rotor made straight: hub, axis, angle and cone by the middles of the three arms.

Between the three-arm search and the joint fit: medians of each arm's points in 1 m bins, one
robust linear fit with what is known of shafts (tilt, cone, and the prior axis where given). Needs
neither pitch nor shape, so that the joint fit starts near and its gates can be narrow.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from perception.coarse_rotor import CoarseRotor
from perception.rotor import angle_of, direction_at, down_in_plane, right_in_plane
from perception.rotor_edges import blade_axes
from perception.values import Float
from perception.voxel_hash import compiled

BIN_M = 1.0
MIN_POINTS = 4
#: A blade is no deeper than this about its axis; what lies further behind its front is not blade.
DEPTH_M = 2.2
TILT_RAD = (math.radians(4.5), math.radians(3.5))
CONE_RAD = (math.radians(2.5), math.radians(2.0))
YAW_SIGMA_RAD = math.radians(7.0)
MIDDLE_SIGMA_M = 0.35
ROUNDS = 2
ENOUGH = 5000
"""Points that say as much as all of them."""


def straighten(
    points_w: Float,
    coarse: CoarseRotor,
    down_w: Float,
    radius_m: float,
    prior_normal_w: Float | None,
) -> tuple[CoarseRotor, float]:
    """Return the coarse rotor moved onto its arms, and its cone (radians, upwind positive).

    ``points_w``: (N, 3) world metres; ``down_w``: (3,); ``prior_normal_w``: (3,) downwind or None.
    """
    hub, normal, angle, cone = coarse.hub_w, coarse.normal_w, coarse.angle_rad, CONE_RAD[0]
    reach = min(radius_m, 30.0)
    points_w = np.ascontiguousarray(points_w[:: -(-len(points_w) // ENOUGH)])
    hub = np.array(hub, np.float64)
    for attempt in range(ROUNDS):
        radial, tangential = blade_axes(normal, down_w, angle)
        right, under = right_in_plane(normal, down_w), down_in_plane(normal, down_w)
        wide = 0.9 + 0.045 * radius_m
        deep = (4.5, 2.5)[attempt]
        middles = []
        for k in range(3):
            arm = np.stack([radial[k], tangential[k], normal])
            gate = np.array([wide, deep, 0.045 * radius_m, reach])
            rows = _middles(points_w, hub, arm, gate, -math.tan(cone))
            middles.append(np.column_stack([rows, np.full(len(rows), k)]))
        table = np.concatenate(middles)
        if len(table) < 9:
            break
        axes = np.stack(
            [radial @ right, radial @ under, tangential @ right, tangential @ under], axis=1
        )
        yaw = None if prior_normal_w is None else -float(prior_normal_w @ right)
        tilt = math.asin(float(np.clip(normal @ down_w, -1, 1))) - TILT_RAD[0]
        move = _solve(table, axes, tilt, yaw)
        hub = hub + move[0] * right + move[1] * under + move[3] * normal
        old = direction_at(angle + float(move[2]), normal, down_w)
        normal = normal - move[4] * right - move[5] * under
        normal = normal / np.linalg.norm(normal)
        angle = angle_of(old - (old @ normal) * normal, normal, down_w)
        cone = float(move[6])
    return CoarseRotor(hub, normal, angle, coarse.score, coarse.arms_m), cone


def _solve(
    table: NDArray[np.float64],
    axes: NDArray[np.float64],
    tilt_rad: float,
    yaw: float | None,
) -> NDArray[np.float64]:
    """Return hub right, down, angle, hub depth, slopes right and down, cone.

    ``table``: (M, 4) r, v, w, blade. ``tilt_rad``: how far the shaft is above the usual tilt;
    ``yaw``: the slope to the right that the prior axis would have.
    """
    r, v, w, blade = table[:, 0], table[:, 1], table[:, 2], table[:, 3].astype(int)
    zero = np.zeros(len(r))
    er_r, er_d, et_r, et_d = axes[blade].T
    jac = np.concatenate(
        [
            np.stack([et_r, et_d, r, zero, zero, zero, zero], axis=1),
            np.stack([zero, zero, zero, zero + 1, r * er_r, r * er_d, -r], axis=1),
        ]
    )
    value = np.concatenate([v, w])
    info = np.diag(
        [0.1, 0.1, 0.1, 0.01, 0.0 if yaw is None else YAW_SIGMA_RAD**-2, TILT_RAD[1] ** -2,
         CONE_RAD[1] ** -2]
    )  # fmt: skip
    pull = info @ np.array([0, 0, 0, 0, yaw or 0.0, tilt_rad, CONE_RAD[0]])
    move: NDArray[np.float64] = np.array([0, 0, 0, 0, 0, 0, CONE_RAD[0]])
    for _ in range(6):
        off = np.abs(value - jac @ move) / MIDDLE_SIGMA_M
        # Middles err together along a blade: a few of them are worth as much as all.
        weight = 0.3 / np.maximum(1.0, off) / (1 + (off / 4) ** 2) / MIDDLE_SIGMA_M**2
        system = (jac * weight[:, None]).T @ jac + info
        move = np.linalg.solve(system, (jac * weight[:, None]).T @ value + pull)
    return move


@compiled
def _middles(points: Float, hub: Float, axes: Float, gate: Float, slope: float) -> Float:
    """Return (M, 3) r, v, w of the middles of one arm's bins.

    ``points``: (N, 3); ``axes``: (3, 3) rows radial, tangential, normal; ``gate``: half width,
    half depth, from and to which radius.
    """
    bins = int(gate[3] / BIN_M) + 1
    local, starts = np.empty((len(points), 3)), np.zeros(bins + 1, np.int64)
    used = 0
    for n in range(len(points)):
        x, y, z = points[n, 0] - hub[0], points[n, 1] - hub[1], points[n, 2] - hub[2]
        r = x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2]
        if not gate[2] < r < gate[3]:
            continue
        v = x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2]
        w = x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2]
        if abs(v) < gate[0] and abs(w - slope * r) < gate[1]:
            local[used, 0], local[used, 1], local[used, 2] = r, v, w
            starts[int(r / BIN_M) + 1] += 1
            used += 1
    for i in range(bins):
        starts[i + 1] += starts[i]
    at, some = starts[:-1].copy(), np.empty(used, np.int64)
    for n in range(used):
        i = int(local[n, 0] / BIN_M)
        some[at[i]] = n
        at[i] += 1
    out = np.empty((bins, 3))
    used = 0
    for i in range(bins):
        part = some[starts[i] : starts[i + 1]]
        if len(part) < MIN_POINTS:
            continue
        front = np.partition(local[part, 2], len(part) // 10)[len(part) // 10]
        part = part[local[part, 2] < front + DEPTH_M]
        out[used, 0] = local[part, 0].mean()
        out[used, 1] = np.median(local[part, 1])
        out[used, 2] = np.median(local[part, 2])
        used += 1
    return out[:used]
