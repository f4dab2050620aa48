"""A blade as a picture shows it: its outline, and what each pixel shows of it.

The blade is a shell of sections along its pitch axis (`perception.blade_section`), put where the
LiDAR found it. A pixel's ray meets the shell at a metre (along the undeflected pitch axis from the
root flange), at a share of the chord from the leading edge, on the pressure or the suction side.
World ENU, metres; pixels as in `perception.lens`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from perception.blade_section import VERTICES, section_outlines
from perception.lens import Lens
from perception.values import CameraPose, Float

Bools = NDArray[np.bool_]

_RAYS_AT_ONCE = 64


@dataclass(frozen=True, slots=True, eq=False)
class BladeStations:
    """Sections along a blade, rising in metre."""

    metre_m: Float
    """(S,) along the undeflected pitch axis from the root flange."""
    centre_w: Float
    """(S, 3) where the pitch axis passes the section."""
    leading_w: Float
    """(S, 3) unit, towards the leading edge."""
    pressure_w: Float
    """(S, 3) unit, outward on the pressure side."""
    chord_m: Float
    """(S,)"""
    thickness: Float
    """(S,) share of the chord."""
    pitch_axis: Float
    """(S,) share of the chord between leading edge and pitch axis."""

    def moved(self, shift_w: Float) -> BladeStations:
        """Return the same sections elsewhere; ``shift_w``: (3,) or (S, 3)."""
        return replace(self, centre_w=self.centre_w + shift_w)

    def shell(self) -> Float:
        """Return the skin (S, VERTICES, 3): from the trailing edge over the suction side round."""
        x, y = section_outlines(self.thickness)
        ahead = (self.pitch_axis[:, None] - x) * self.chord_m[:, None]
        out = -y * self.chord_m[:, None]
        return np.asarray(
            self.centre_w[:, None]
            + ahead[:, :, None] * self.leading_w[:, None]
            + out[:, :, None] * self.pressure_w[:, None],
            np.float64,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What N pixels show; NaN where they miss the blade."""

    metre_m: Float
    """(N,)"""
    chord_share: Float
    """(N,) 0 at the leading edge, 1 at the trailing edge."""
    pressure: Bools
    """(N,) on the pressure side."""
    point_w: Float
    """(N, 3)"""
    depth_m: Float
    """(N,) along the optical axis."""
    cosine: Float
    """(N,) of the angle between the ray and the skin's normal."""

    @property
    def hit(self) -> Bools:
        """(N,) which pixels show the blade."""
        return np.isfinite(self.metre_m)


def see(stations: BladeStations, pixels: Float, camera: CameraPose, lens: Lens) -> Seen:
    """Return what pixels (N, 2) show of a blade."""
    rays_w = lens.rays(pixels) @ camera.rotation_wc.T
    parts = [
        _cast(stations, camera.position_w, rays_w[k : k + _RAYS_AT_ONCE])
        for k in range(0, len(rays_w), _RAYS_AT_ONCE)
    ]
    if not parts:
        none = np.zeros(0)
        return Seen(none, none, np.zeros(0, bool), np.zeros((0, 3)), none, none)
    metre, share, pressure, ranges, cosine = (
        np.concatenate([part[k] for part in parts]) for k in range(5)
    )
    points = camera.position_w + ranges[:, None] * rays_w
    depth = (points - camera.position_w) @ camera.rotation_wc[:, 2]
    return Seen(metre, share, pressure.astype(bool), points, depth, cosine)


def _cast(stations: BladeStations, eye_w: Float, rays_w: Float) -> tuple[Float, ...]:
    """Return metre, chord share, pressure side, range and cosine, each (R,), of rays (R, 3)."""
    a, b, c, of_a, of_b, of_c = _triangles(stations)
    ab, ac = b - a, c - a
    # Moeller and Trumbore, every ray with every triangle.
    cross = np.cross(rays_w[:, None], ac[None])
    along = np.einsum("rtk,tk->rt", cross, ab)
    along = np.where(np.abs(along) < 1e-12, np.nan, along)
    from_a = eye_w - a
    u = np.einsum("rtk,tk->rt", cross, from_a) / along
    other = np.cross(from_a, ab)
    v = rays_w @ other.T / along
    ranges = np.einsum("tk,tk->t", other, ac) / along
    inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (ranges > 0)
    ranges = np.where(inside, ranges, np.inf)
    first = ranges.argmin(axis=1)
    rows = np.arange(len(rays_w))
    hit = np.isfinite(ranges[rows, first])
    u, v = u[rows, first], v[rows, first]
    values = (
        (1 - u - v)[:, None] * of_a[first] + u[:, None] * of_b[first] + v[:, None] * of_c[first]
    )
    normals = np.cross(ab, ac)[first]
    cosine = np.abs(np.einsum("rk,rk->r", normals, rays_w)) / np.linalg.norm(normals, axis=1)
    nothing = np.nan
    return (
        np.where(hit, values[:, 0], nothing),
        np.where(hit, np.clip(values[:, 1], 0, 1), nothing),
        np.where(hit, values[:, 2] < 0, False),
        np.where(hit, ranges[rows, first], nothing),
        np.where(hit, cosine, nothing),
    )


def _triangles(stations: BladeStations) -> tuple[Float, Float, Float, Float, Float, Float]:
    """Return corners (T, 3) of the shell and of each corner metre, chord share, side (T, 3)."""
    shell = stations.shell()
    x, y = section_outlines(stations.thickness)
    # A section's own camber must not make the nose count to one side: it lies at height zero.
    height = y - np.where(x < 1e-6, y, 0.0)
    of = np.stack([np.broadcast_to(stations.metre_m[:, None], x.shape), x, height], axis=2)
    after = (np.arange(VERTICES) + 1) % VERTICES
    corners = [shell[:-1], shell[1:], shell[:-1, after], shell[1:, after]]
    values = [of[:-1], of[1:], of[:-1, after], of[1:, after]]
    order = ((0, 1, 2), (3, 2, 1))
    a, b, c = (np.concatenate([corners[tri[k]].reshape(-1, 3) for tri in order]) for k in range(3))
    of_a, of_b, of_c = (
        np.concatenate([values[tri[k]].reshape(-1, 3) for tri in order]) for k in range(3)
    )
    return a, b, c, of_a, of_b, of_c


def edges_px(stations: BladeStations, camera: CameraPose, lens: Lens) -> tuple[Float, Float]:
    """Return the blade's two edges in the picture, (K, 2) pixels each, root to tip.

    Sections behind the camera are left out; the edges may leave the picture. Both are empty where
    fewer than two sections lie ahead.
    """
    shell = stations.shell()
    flat = (shell.reshape(-1, 3) - camera.position_w) @ camera.rotation_wc
    pixels, ahead = lens.pixels(flat)
    pixels, ahead = pixels.reshape(*shell.shape[:2], 2), ahead.reshape(shell.shape[:2])
    pixels = pixels[ahead.all(axis=1)]
    if len(pixels) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    middle = pixels.mean(axis=1)
    along = np.gradient(middle, axis=0)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = along / np.maximum(length, 1e-9)
    aside = np.column_stack([-along[:, 1], along[:, 0]])
    across = np.einsum("svk,sk->sv", pixels - middle[:, None], aside)
    rows = np.arange(len(pixels))
    return pixels[rows, across.argmax(axis=1)], pixels[rows, across.argmin(axis=1)]


def outline_px(stations: BladeStations, camera: CameraPose, lens: Lens) -> Float:
    """Return the blade's outline (K, 2) in pixels: along one edge, back along the other."""
    one, other = edges_px(stations, camera, lens)
    return np.concatenate([one, other[::-1]])


def clipped(polygon_px: Float, width_px: int, height_px: int) -> Float:
    """Return the part (K, 2) of a polygon (N, 2) inside the picture (Sutherland and Hodgman)."""
    polygon = polygon_px
    for axis, limit, sign in ((0, 0.0, 1), (0, width_px, -1), (1, 0.0, 1), (1, height_px, -1)):
        if len(polygon) == 0:
            break
        inside = sign * (polygon[:, axis] - limit)
        kept: list[Float] = []
        for k in range(len(polygon)):
            a, b = inside[k - 1], inside[k]
            if (a < 0) != (b < 0):
                kept.append(polygon[k - 1] + (polygon[k] - polygon[k - 1]) * (a / (a - b)))
            if b >= 0:
                kept.append(polygon[k])
        polygon = np.array(kept).reshape(-1, 2)
    return polygon
