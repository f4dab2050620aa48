"""Radiance of what rays hit. Compiled, float32; units as in `light`.

Surfaces are Lambert with a little gloss, lit by the sun, the sky above and the ground below. No
shadows are cast: sides differ because they face the sun or not.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.simulated.texture import blade_albedo, value_noise
from perception.values import Bytes, Float32

_TOWER, _NACELLE, _HUB, _GROUND, _TREE, _BUILDING, _OTHER, _SKY = 3, 4, 5, 6, 7, 8, 9, 10
#: Channels of a point that picture interpolation carries: normal (3), metre, arc.
CHANNELS = 5


@njit(cache=True, nogil=True, fastmath=True)
def sky_radiance(dx: float, dy: float, dz: float, light: Float32) -> float:  # pragma: no cover
    """Return the sky's radiance in a unit direction."""
    direct, diffuse, cloudiness = light[3], light[4], light[5]
    if dz < 0.0:  # beyond the edge of the ground: distant land in haze
        return float(0.7 * diffuse + 0.12 * direct)
    up = dz
    base = diffuse * (0.8 + 0.9 * (1.0 - up) ** 4)
    near = max(0.0, dx * light[0] + dy * light[1] + dz * light[2])
    glow = direct * (0.25 * near**8 + 0.9 * near**80 + 40.0 * (1.0 if near > 0.99996 else 0.0))
    # A layer of clouds, seen in perspective.
    reach = 1.0 / (up + 0.12)
    x, y = dx * reach * 1.7, dy * reach * 1.7
    cloud = 0.6 * value_noise(x + 11.0, y + 5.0) + 0.4 * value_noise(3.1 * x, 3.1 * y + 40.0)
    cover = min(1.0, max(0.0, (cloud - 0.62 + 0.5 * cloudiness) * 4.0))
    cover *= min(1.0, up / 0.10)  # at the horizon the layer melts into haze
    bright = 0.42 * direct + 1.15 * diffuse
    return float(base * (1.0 - cover) + bright * cover + glow * (1.0 - 0.7 * cover))


@njit(cache=True, nogil=True, fastmath=True)
def _albedo(
    part: int, x: float, y: float, z: float, range_m: float
) -> float:  # pragma: no cover - compiled
    if part == _TOWER:
        albedo = 0.62 + 0.05 * value_noise(x * 2.0 + y * 3.0, z * 0.35)
        weld = abs((z / 2.9) % 1.0 - 0.5)
        return albedo - (0.12 if weld < 0.006 else 0.0)
    if part in (_NACELLE, _HUB):
        return 0.66 + 0.06 * value_noise(x * 1.4 + 0.7 * y, z * 1.4 + 0.3 * y)
    if part == _GROUND:
        field = value_noise(x / 38.0, y / 52.0)
        tuft = value_noise(x / 3.1, y / 3.1) if range_m < 300.0 else 0.5
        grain = value_noise(x * 1.7, y * 1.7) if range_m < 60.0 else 0.5
        track = 0.10 if abs(x - 14.0 * np.sin(y / 45.0)) < 2.2 else 0.0
        return 0.10 + 0.12 * field + 0.07 * tuft + 0.06 * grain + track
    if part == _TREE:
        return 0.06 + 0.08 * value_noise(x * 1.1 + z, y * 1.1 - z)
    if part == _BUILDING:
        return 0.35 + 0.1 * value_noise(x * 0.5, z * 0.9 + y * 0.5)
    return 0.6


@njit(cache=True, nogil=True, fastmath=True)
def surface_radiance(
    part: int,
    nx: float,
    ny: float,
    nz: float,
    metre: float,
    arc: float,
    dx: float,
    dy: float,
    dz: float,
    range_m: float,
    eye: Float32,
    light: Float32,
    length_m: float,
    table: Float32,
    first: NDArray[np.int32],
    order: NDArray[np.int32],
) -> float:  # pragma: no cover - compiled
    """Return the radiance that reaches the eye (3,) along a unit direction from a surface."""
    facing = nx * dx + ny * dy + nz * dz
    if facing > 0.0:  # smoothed normals may lean away at the rim
        nx, ny, nz = nx - facing * dx, ny - facing * dy, nz - facing * dz
    if part < 3:
        albedo = blade_albedo(part, metre, arc, length_m, range_m, table, first, order)
    else:
        x, y, z = eye[0] + range_m * dx, eye[1] + range_m * dy, eye[2] + range_m * dz
        albedo = _albedo(part, x, y, z, range_m)
    direct, diffuse = light[3], light[4]
    sun = nx * light[0] + ny * light[1] + nz * light[2]
    lit = max(0.0, sun) * direct
    level = direct * max(0.0, light[2]) + diffuse
    lit += 0.5 * (1.0 + nz) * diffuse + 0.5 * (1.0 - nz) * 0.18 * level
    radiance = albedo * lit
    if sun > 0.0 and part <= _HUB:
        hx, hy, hz = light[0] - dx, light[1] - dy, light[2] - dz
        half = (nx * hx + ny * hy + nz * hz) / np.sqrt(hx * hx + hy * hy + hz * hz)
        if half > 0.8:
            gloss = half * half  # to the 64th power, by squaring
            for _ in range(5):
                gloss *= gloss
            radiance += 0.35 * direct * gloss
    clear = np.exp(-light[6] * range_m)
    return float(radiance * clear + (1.0 - clear) * (1.1 * diffuse + 0.25 * direct))


@njit(cache=True, nogil=True, fastmath=True)
def attributes(
    triangle: NDArray[np.int32],
    uv: Float32,
    triangles: NDArray[np.uint32],
    vertex: Float32,
    part: Bytes,
    rotations: Float32,
) -> tuple[Bytes, Float32]:  # pragma: no cover - compiled
    """Return (N,) parts and (N, 5) smooth normal, metre and arc of N hits.

    ``vertex``: (V, 5) the same of each vertex at time 0; ``rotations``: (3, 3, 3) of rotor, nacelle
    and the rest since then.
    """
    parts = np.empty(len(triangle), np.uint8)
    out = np.zeros((len(triangle), CHANNELS), np.float32)
    for i in range(len(triangle)):
        t = triangle[i]
        if t < 0:
            parts[i] = _SKY
            continue
        p = part[t]
        parts[i] = p
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        u, v = uv[i, 0], uv[i, 1]
        w = np.float32(1.0) - u - v
        for k in range(CHANNELS):
            out[i, k] = w * vertex[a, k] + u * vertex[b, k] + v * vertex[c, k]
        group = 0 if (p < 3 or p == _HUB) else 1 if p == _NACELLE else 2
        r = rotations[group]
        x, y, z = out[i, 0], out[i, 1], out[i, 2]
        scale = 1.0 / max(1e-6, np.sqrt(x * x + y * y + z * z))
        out[i, 0] = scale * (r[0, 0] * x + r[0, 1] * y + r[0, 2] * z)
        out[i, 1] = scale * (r[1, 0] * x + r[1, 1] * y + r[1, 2] * z)
        out[i, 2] = scale * (r[2, 0] * x + r[2, 1] * y + r[2, 2] * z)
    return parts, out


@njit(cache=True, nogil=True, fastmath=True)
def shade_rays(
    parts: Bytes,
    points: Float32,
    directions: Float32,
    range_m: Float32,
    eye: Float32,
    light: Float32,
    length_m: float,
    table: Float32,
    first: NDArray[np.int32],
    order: NDArray[np.int32],
) -> Float32:  # pragma: no cover - compiled
    """Return (N,) radiances of N rays with their hits' `attributes`."""
    out = np.empty(len(parts), np.float32)
    for i in range(len(parts)):
        dx, dy, dz = directions[i]
        if parts[i] == _SKY:
            out[i] = sky_radiance(dx, dy, dz, light)
            continue
        n = points[i]
        out[i] = surface_radiance(
            parts[i], n[0], n[1], n[2], n[3], n[4], dx, dy, dz, range_m[i],
            eye, light, length_m, table, first, order,
        )  # fmt: skip
    return out
