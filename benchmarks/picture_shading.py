"""Radiance of the hard backgrounds: sky with cloud edges, farmland, roads, rock, villages.

Compiled, float32. Units as in `drivers.simulated.light`: a white sheet in full sun is about 1. The
surfaces are lit by the sun (where the ray caster says that it reaches them), sky and ground.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.simulated.texture import value_noise
from perception.values import Bytes, Float32

_TOWER, _NACELLE, _HUB, _GROUND, _TREE, _BUILDING, _OTHER, _SKY = 3, 4, 5, 6, 7, 8, 9, 10
#: Columns of the site's row, see `benchmarks.picture_background.Site.packed`.
SITE = 8


@njit(cache=True, nogil=True, fastmath=True)
def _fractal(x: float, y: float, octaves: int) -> float:  # pragma: no cover - compiled
    total, size, weight = 0.0, 1.0, 0.5
    for _ in range(octaves):
        total += weight * value_noise(x * size + 17.0, y * size + 31.0)
        size *= 2.03
        weight *= 0.5
    return total


@njit(cache=True, nogil=True, fastmath=True)
def _sky(
    dx: float, dy: float, dz: float, light: Float32, site: Float32, trails: Float32
) -> float:  # pragma: no cover - compiled
    direct, diffuse, cover_mean = light[3], light[4], light[5]
    up = max(dz, 0.0)
    near = max(0.0, dx * light[0] + dy * light[1] + dz * light[2])
    base = diffuse * (0.9 + 1.1 * (1.0 - up) ** 5)
    glow = direct * (0.20 * near**6 + 0.7 * near**60 + 3.0 * near**600)
    disc = 40.0 * direct if near > 0.99998 else 0.0
    reach = 1.0 / (up + 0.10)
    x, y = dx * reach * site[0] + site[1], dy * reach * site[0] + site[2]
    thick = _fractal(x, y, 6)
    cover = min(1.0, max(0.0, (thick - 0.72 + 0.55 * cover_mean) * site[3]))
    cover *= min(1.0, up / 0.04 + 0.25)
    # Clouds are brightest at their rim against the sun and grey where they are thick.
    shade = 1.0 - 0.55 * min(1.0, max(0.0, thick - 0.55) * 2.5)
    cloud = (0.55 * direct + 1.3 * diffuse) * shade + 0.5 * glow
    sky = base + glow
    for k in range(len(trails)):
        off = abs(dx * trails[k, 0] + dy * trails[k, 1] + dz * trails[k, 2] + trails[k, 3])
        if off < trails[k, 4]:
            fray = 0.55 + 0.45 * value_noise(40.0 * dx, 40.0 * dy)
            sky += trails[k, 5] * (direct + diffuse) * fray * (1.0 - off / trails[k, 4])
    return float(sky * (1.0 - cover) + cloud * cover + disc * (1.0 - cover))


@njit(cache=True, nogil=True, fastmath=True)
def _ground(
    x: float, y: float, nz: float, range_m: float, site: Float32, roads: Float32
) -> float:  # pragma: no cover - compiled
    """Albedo: parcels with straight borders, rows of crops, roads; forest and rock on slopes."""
    c, s = np.cos(site[4]), np.sin(site[4])
    u, v = c * x + s * y, -s * x + c * y
    u += 9.0 * (value_noise(v / 260.0, 3.0) - 0.5) * 6.0
    width = site[5]
    row = np.floor(u / width)
    length = width * (1.2 + 2.5 * value_noise(row * 3.7, 9.0))
    column = np.floor(v / length + 5.0 * value_noise(row * 1.3, 2.0))
    field = value_noise(row * 7.31 + 0.5, column * 5.77 + 0.5)
    tuft = value_noise(x / 4.0, y / 4.0) if range_m < 700.0 else 0.5
    albedo = 0.05 + 0.19 * field + 0.05 * tuft
    if range_m < 450.0 and field > 0.75:  # vines or young crops in rows
        albedo += 0.03 * np.sin(u * 6.28 / 3.4)
    border = abs(u / width - row - 0.5) * 2.0
    if border > 1.0 - 2.4 / width:
        albedo *= 0.55  # hedges and ditches
    wild = min(
        1.0, max(0.0, (0.94 - nz) * 9.0 + site[6] * (_fractal(x / 300.0, y / 300.0, 4) - 0.2))
    )
    if wild > 0.0:
        rock = 0.04 + 0.26 * _fractal(x / 45.0, y / 45.0, 5) ** 2 * (1.0 + 2.5 * (1.0 - nz))
        albedo = albedo * (1.0 - wild) + wild * rock
    for k in range(len(roads)):
        bend = roads[k, 4] * np.sin((-roads[k, 1] * x + roads[k, 0] * y) / roads[k, 5])
        off = abs(roads[k, 0] * x + roads[k, 1] * y - roads[k, 2] + bend)
        if off < roads[k, 3]:
            albedo = roads[k, 6]
            if off < 0.12 and roads[k, 3] > 3.0:
                albedo = 0.6
        elif off < roads[k, 3] + 1.2:
            albedo *= 0.7
    return float(albedo)


@njit(cache=True, nogil=True, fastmath=True)
def _albedo(
    part: int, x: float, y: float, z: float, nz: float, range_m: float, metre: float,
    site: Float32, roads: Float32,
) -> float:  # pragma: no cover - compiled  # fmt: skip
    if part < 3:
        stain = 0.10 * _fractal(metre * 0.7 + 31.0 * part, z * 0.9, 4)
        seam = 0.10 if (metre / 7.3) % 1.0 < 0.006 else 0.0
        return 0.72 - stain - seam - (0.08 if metre < 1.2 else 0.0)
    if part == _TOWER:
        weld = 0.14 if abs((z / 2.9) % 1.0 - 0.5) < 0.008 else 0.0
        streak = 0.12 * value_noise((x - y) * 5.0, z * 0.08) * value_noise(x + y, z * 0.5)
        return 0.68 - weld - streak
    if part in (_NACELLE, _HUB):
        return 0.66 - 0.10 * _fractal(x * 0.8 + 0.4 * y, z * 0.9, 4)
    if part == _GROUND:
        return _ground(x, y, nz, range_m, site, roads)
    if part == _TREE:
        return 0.03 + 0.09 * _fractal(x * 0.9 + z, y * 0.9 - z, 3)
    if part == _BUILDING:
        if nz > 0.25:  # roofs: red, brown, slate
            return 0.10 + 0.22 * value_noise(np.floor(x / 14.0) * 3.1, np.floor(y / 14.0) * 2.7)
        window = (0.5 * (x + y)) % 2.6 < 0.9 and z % 2.8 > 1.2
        wall = 0.35 + 0.45 * value_noise(np.floor(x / 14.0) * 1.9, np.floor(y / 14.0) * 4.3)
        return 0.08 if window else wall
    return 0.68


@njit(cache=True, nogil=True, fastmath=True)
def shade(
    parts: Bytes,
    normals: Float32,
    metres: Float32,
    sunlit: NDArray[np.bool_],
    directions: Float32,
    range_m: Float32,
    eye: Float32,
    light: Float32,
    site: Float32,
    roads: Float32,
    trails: Float32,
) -> Float32:  # pragma: no cover - compiled
    """Return (N,) radiances of N rays from ``eye`` (3,).

    ``parts``: (N,) `drivers.simulated.mesh.Part`; ``normals``: (N, 3) smooth; ``metres``: (N,)
    along the blade; ``sunlit``: (N,); ``directions``: (N, 3) unit; ``light``: `Light.packed`.
    """
    out = np.empty(len(parts), np.float32)
    direct, diffuse = light[3], light[4]
    level = direct * max(0.0, light[2]) + diffuse
    for i in range(len(parts)):
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        near = max(0.0, dx * light[0] + dy * light[1] + dz * light[2])
        veil = 1.15 * diffuse + 0.25 * direct + direct * 0.35 * near**8
        if parts[i] == _SKY:
            sky = _sky(dx, dy, dz, light, site, trails)
            low = min(1.0, np.exp(-max(0.0, dz) * 3.0e-4 / light[6] * 40.0))
            out[i] = sky * (1.0 - 0.5 * low) + 0.5 * low * veil
            continue
        x = eye[0] + range_m[i] * dx
        y = eye[1] + range_m[i] * dy
        z = eye[2] + range_m[i] * dz
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        facing = nx * dx + ny * dy + nz * dz
        if facing > 0.0:  # smoothed normals may lean away at the rim
            nx, ny, nz = nx - facing * dx, ny - facing * dy, nz - facing * dz
        albedo = _albedo(parts[i], x, y, z, nz, range_m[i], metres[i], site, roads)
        sun = nx * light[0] + ny * light[1] + nz * light[2]
        lit = 0.5 * (1.0 + nz) * diffuse + 0.5 * (1.0 - nz) * 0.17 * level
        if sunlit[i] and sun > 0.0:
            lit += sun * direct
        radiance = albedo * lit
        if sunlit[i] and sun > 0.0 and parts[i] <= _HUB:
            hx, hy, hz = light[0] - dx, light[1] - dy, light[2] - dz
            half = (nx * hx + ny * hy + nz * hz) / np.sqrt(hx * hx + hy * hy + hz * hz)
            radiance += 0.30 * direct * max(0.0, half) ** 50
        clear = np.exp(-light[6] * range_m[i])
        out[i] = radiance * clear + (1.0 - clear) * veil
    return out
