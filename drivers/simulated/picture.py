"""What the camera sees, as radiance: a coarse grid of rays, refined where it is not smooth.

One ray every four pixels both ways. Where the four rays round a block hit the same smooth surface
the block's pixels take their normal, blade metre and arc in between (turbine) or simply the
radiance (sky, ground); elsewhere (edges, tips, far trees) every pixel is cast. That is a tenth of
the rays.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config.sensors import Camera
from drivers.simulated.light import Light
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.shading import CHANNELS, attributes, shade_rays, surface_radiance
from drivers.simulated.texture import Defects
from perception.values import Bytes, CameraPose, Float32

_BLOCK = 4
_HUB, _SKY = 5, 10


@dataclass(frozen=True, slots=True, eq=False)
class Radiance:
    """A picture before any camera: (H, W) radiance and `Part` of each pixel."""

    radiance: Float32
    part: Bytes
    centre_m: float
    """Range along the optical axis; inf where it meets the sky."""


class Picture:
    """Draws the world of one ray caster."""

    def __init__(
        self, caster: Raycaster, camera: Camera, defects: Defects, blade_length_m: float
    ) -> None:
        self._caster, self._defects, self._length_m = caster, defects, blade_length_m
        self._focal_widths = camera.focal_length_mm / camera.sensor_width_mm
        mesh = caster.mesh
        self._vertex = np.concatenate(
            [mesh.normals, mesh.metre[:, None], mesh.arc[:, None]], axis=1
        ).astype(np.float32)

    def draw(self, pose: CameraPose, light: Light, width_px: int, height_px: int) -> Radiance:
        """Return the picture seen from a pose, without the finest texture: for the live view."""
        bands = self.draw_in_bands(pose, light, width_px, height_px, height_px, fine=False)
        while (drawn := next(bands)) is None:
            pass
        return drawn

    def draw_in_bands(
        self,
        pose: CameraPose,
        light: Light,
        width_px: int,
        height_px: int,
        band_px: int,
        *,
        fine: bool = True,
    ) -> Iterator[Radiance | None]:
        """Draw in bands of rows; yield None after each but the last, then the picture.

        Between two bands the caller may do what is more urgent. Width, height and band are
        multiples of 4 pixels. Without ``fine`` the turbine's texture is that of the grid of rays.
        """
        radiance = np.empty((height_px, width_px), np.float32)
        part = np.empty((height_px, width_px), np.uint8)
        for top in range(0, height_px, band_px):
            bottom = min(height_px, top + band_px)
            self._draw_band(pose, light, radiance, part, top, bottom, fine=fine)
            if bottom < height_px:
                yield None
        axis = pose.rotation_wc[:, 2].astype(np.float32)[None]
        eye = pose.position_w.astype(np.float32)
        centre = self._caster.cast(eye[None], axis, pose.stamp_s)
        yield Radiance(radiance, part, float(centre.range_m[0]))

    def _draw_band(
        self,
        pose: CameraPose,
        light: Light,
        radiance: Float32,
        part: Bytes,
        top: int,
        bottom: int,
        *,
        fine: bool,
    ) -> None:
        height, width = radiance.shape
        rotation = pose.rotation_wc.astype(np.float32)
        eye = pose.position_w.astype(np.float32)
        focal = self._focal_widths * width
        motions = self._caster.motions(pose.stamp_s)
        rotations = np.stack([motion.rotation for motion in motions]).astype(np.float32)
        mesh, defects, packed = self._caster.mesh, self._defects, light.packed()

        def look(x: Float32, y: Float32) -> tuple[Bytes, Float32, Float32, Float32, Float32]:
            rays = _directions(x, y, rotation, focal, width, height)
            hits = self._caster.cast(np.broadcast_to(eye, rays.shape), rays, pose.stamp_s)
            parts, points = attributes(
                hits.triangle, hits.uv, mesh.triangles, self._vertex, mesh.part, rotations
            )
            shades = shade_rays(
                parts, points, rays, hits.range_m, eye, packed,
                self._length_m, defects.table, defects.first, defects.order,
            )  # fmt: skip
            return parts, points, rays, hits.range_m, shades

        columns, rows = width // _BLOCK + 1, (bottom - top) // _BLOCK + 1
        grid_x = np.tile(np.arange(columns, dtype=np.float32) * _BLOCK, rows)
        grid_y = np.repeat(top + np.arange(rows, dtype=np.float32) * _BLOCK, columns)
        parts, points, rays, ranges, shades = look(grid_x, grid_y)
        rough = _fill_smooth(
            radiance, part, top, rows, columns, parts, points, rays, ranges, shades,
            eye, packed, self._length_m, defects.table, defects.first, defects.order, fine,
        )  # fmt: skip
        if len(rough):
            within = np.arange(_BLOCK * _BLOCK)
            y = (rough[:, :1] + within // _BLOCK).ravel()
            x = (rough[:, 1:] + within % _BLOCK).ravel()
            edge_parts, _, _, _, edge_shades = look(x.astype(np.float32), y.astype(np.float32))
            radiance[y, x] = edge_shades
            part[y, x] = edge_parts


@njit(cache=True, nogil=True, fastmath=True)
def _directions(
    x: Float32, y: Float32, rotation: Float32, focal_px: float, width: int, height: int
) -> Float32:  # pragma: no cover - compiled
    """Return (N, 3) unit directions in the world through (N,) pixel centres."""
    out = np.empty((len(x), 3), np.float32)
    for i in range(len(x)):
        u = (x[i] + np.float32(0.5 - 0.5 * width)) / focal_px
        v = (y[i] + np.float32(0.5 - 0.5 * height)) / focal_px
        scale = np.float32(1.0) / np.sqrt(u * u + v * v + np.float32(1.0))
        for k in range(3):
            out[i, k] = scale * (rotation[k, 0] * u + rotation[k, 1] * v + rotation[k, 2])
    return out


@njit(cache=True, nogil=True, fastmath=True)
def _is_smooth(
    a: int, b: int, c: int, d: int, parts: Bytes, points: Float32, ranges: Float32
) -> bool:  # pragma: no cover - compiled
    p = parts[a]
    if parts[b] != p or parts[c] != p or parts[d] != p:
        return False
    if p == _SKY:
        return True
    if p == 7 or p == 9:  # trees and the far turbine: finer than the grid
        return False
    low = min(ranges[a], ranges[b], ranges[c], ranges[d])
    high = max(ranges[a], ranges[b], ranges[c], ranges[d])
    if p == 6:
        return bool(high < 1.6 * low)
    if high - low > 0.4:
        return False
    for i in (b, c, d):
        dot = (
            points[a, 0] * points[i, 0] + points[a, 1] * points[i, 1] + points[a, 2] * points[i, 2]
        )
        if dot < 0.97 or abs(points[a, 4] - points[i, 4]) > 0.3:
            return False
    return True


@njit(cache=True, nogil=True, fastmath=True)
def _fill_smooth(
    radiance: Float32,
    part: Bytes,
    top: int,
    rows: int,
    columns: int,
    parts: Bytes,
    points: Float32,
    rays: Float32,
    ranges: Float32,
    shades: Float32,
    eye: Float32,
    light: Float32,
    length_m: float,
    table: Float32,
    first: NDArray[np.int32],
    order: NDArray[np.int32],
    fine: bool,
) -> NDArray[np.int64]:  # pragma: no cover - compiled
    """Fill the smooth blocks of a band; return (M, 2) upper left pixels (y, x) of the others."""
    rough = np.empty(((rows - 1) * (columns - 1), 2), np.int64)
    count = 0
    mixed = np.empty(CHANNELS, np.float32)
    for row in range(rows - 1):
        for column in range(columns - 1):
            a = row * columns + column
            b, c, d = a + 1, a + columns, a + columns + 1
            y0, x0 = top + row * _BLOCK, column * _BLOCK
            if not _is_smooth(a, b, c, d, parts, points, ranges):
                rough[count, 0], rough[count, 1] = y0, x0
                count += 1
                continue
            p = parts[a]
            for i in range(_BLOCK):
                v = np.float32(i / _BLOCK)
                for j in range(_BLOCK):
                    u = np.float32(j / _BLOCK)
                    wa, wb, wc, wd = (1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v
                    part[y0 + i, x0 + j] = p
                    if p > _HUB or not fine:
                        radiance[y0 + i, x0 + j] = (
                            wa * shades[a] + wb * shades[b] + wc * shades[c] + wd * shades[d]
                        )
                        continue
                    for k in range(CHANNELS):
                        mixed[k] = (
                            wa * points[a, k]
                            + wb * points[b, k]
                            + wc * points[c, k]
                            + wd * points[d, k]
                        )
                    dx = wa * rays[a, 0] + wb * rays[b, 0] + wc * rays[c, 0] + wd * rays[d, 0]
                    dy = wa * rays[a, 1] + wb * rays[b, 1] + wc * rays[c, 1] + wd * rays[d, 1]
                    dz = wa * rays[a, 2] + wb * rays[b, 2] + wc * rays[c, 2] + wd * rays[d, 2]
                    far = wa * ranges[a] + wb * ranges[b] + wc * ranges[c] + wd * ranges[d]
                    radiance[y0 + i, x0 + j] = surface_radiance(
                        p, mixed[0], mixed[1], mixed[2], mixed[3], mixed[4],
                        dx, dy, dz, far, eye, light, length_m, table, first, order,
                    )  # fmt: skip
    return rough[:count]
