"""How bright the blade is in a picture.

The paper's way is the mean grey of a disc round the projected inspection point (Shi et al. 2025,
Eq. 5 and 6). Beyond it: the mean over the blade's own outline as projected from the fitted axis,
so that sky in the disc of a narrow tip does not speak for the blade.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.projection import project, project_all
from perception.values import Bytes, CameraPose, Float

#: Grey levels at which the sensor or the tone curve is at its end.
WHITE = 253
BLACK = 2
MIN_PIXELS = 12
#: The whole picture is counted on about so many columns.
_COUNTED_ACROSS = 200
#: A window of more pixels is counted on some of its rows.
_COUNTED_PX = 50_000
#: Parts of a pixel that OpenCV draws to, and their bits.
_FINE_BITS = 4
_FINE = 1 << _FINE_BITS
_LOW_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class Metered:
    """Brightness of the blade's region."""

    mean_grey: float
    """mu_g, 0-255."""
    clipped: float
    """Share of the pixels that are saturated white."""
    black: float
    """Share of the pixels that are at the black end."""
    pixels: int
    """|C_f|"""
    low_grey: float = math.nan
    """Grey that a tenth of the pixels stay below: what is left to see when the rest is white."""


def meter_disc(grey: Bytes, centre_px: Float | None, radius_px: float) -> Metered | None:
    """Return the metering of the disc C_f (Eq. 5, 6), clipped at the picture's borders.

    ``grey``: (H, W) G; ``centre_px``: (2,) p_f in the picture, None behind the camera;
    ``radius_px``: r_f. None where the disc misses the picture.
    """
    if centre_px is None or not np.isfinite(centre_px).all() or grey.ndim != 2:
        return None
    height, width = grey.shape
    x, y = float(centre_px[0]), float(centre_px[1])
    left, right = max(int(np.ceil(x - radius_px)), 0), min(int(x + radius_px) + 1, width)
    top, bottom = max(int(np.ceil(y - radius_px)), 0), min(int(y + radius_px) + 1, height)
    if left >= right or top >= bottom:
        return None
    across = (np.arange(left, right) - x) ** 2
    down = (np.arange(top, bottom) - y) ** 2
    inside = down[:, None] + across[None, :] <= radius_px * radius_px
    return _metered(grey[top:bottom, left:right], inside.astype(np.uint8))


def meter_point(
    grey: Bytes, point_w: Float, camera: CameraPose, matrix: Float, disc_radius: float
) -> Metered | None:
    """Return the metering of the disc round a world point (Eq. 4 to 6).

    ``disc_radius``: r_f as a share of the picture's width.
    """
    return meter_disc(grey, project(point_w, camera, matrix), disc_radius * grey.shape[1])


def blade_outline(
    root_w: Float,
    tip_w: Float,
    half_width_m: Float | float,
    camera: CameraPose,
    matrix: Float,
    *,
    stations: int = 60,
) -> Float | None:
    """Return the outline (M, 2) px of the blade's capsule, None where nothing is before the camera.

    ``half_width_m``: scalar, or (``stations``,) from root to tip: half of the width that surely is
    blade as seen from here. Parts behind the camera are left out.
    """
    share = np.linspace(0.0, 1.0, stations)
    axis_w = root_w + share[:, None] * (tip_w - root_w)
    pixels, ahead = project_all(axis_w, camera, matrix)
    if int(ahead.sum()) < 2:
        return None
    depth = (axis_w - camera.position_w) @ camera.rotation_wc[:, 2]
    half_px = np.broadcast_to(half_width_m, stations) * matrix[0, 0] / np.maximum(depth, 0.1)
    pixels, half_px = pixels[ahead], half_px[ahead]
    # Of a straight axis the picture is straight too.
    x, y = (pixels[-1] - pixels[0]).tolist()
    size = max(math.hypot(x, y), 1e-9)
    aside = half_px[:, None] * np.array([-y / size, x / size])
    return np.asarray(np.concatenate([pixels + aside, (pixels - aside)[::-1]]), np.float64)


def meter_outline(
    grey: Bytes, outline_px: Float | None, near_px: Float | None = None, reach_px: float = np.inf
) -> Metered | None:
    """Return the metering of all pixels inside an outline (M, 2), None where it misses the picture.

    ``near_px``, ``reach_px``: only pixels within this distance of a point count, so that the part
    that the still will show decides.
    """
    if outline_px is None or grey.ndim != 2 or not np.isfinite(outline_px).all():
        return None
    height, width = grey.shape
    # Far beyond the borders rasterising wastes time and overflows its fixed point.
    low, high = (-4.0 * width, -4.0 * height), (5.0 * width, 5.0 * height)
    polygon = np.clip(outline_px, low, high)
    corner = np.clip(np.floor(polygon.min(axis=0)), 0, (width, height)).astype(int)
    end = np.clip(np.ceil(polygon.max(axis=0)) + 1, 0, (width, height)).astype(int)
    if near_px is not None and np.isfinite(reach_px):
        corner = np.maximum(corner, np.floor(near_px - reach_px).astype(int))
        end = np.minimum(end, np.ceil(near_px + reach_px).astype(int) + 1)
    if (corner >= end).any():
        return None
    mask = np.zeros((end[1] - corner[1], end[0] - corner[0]), np.uint8)
    cv2.fillPoly(mask, [np.round(polygon - corner).astype(np.int32)], 1)
    if near_px is not None and np.isfinite(reach_px):
        disc = np.zeros_like(mask)
        x, y = np.round(_FINE * (near_px - corner)).astype(int)
        cv2.circle(disc, (int(x), int(y)), round(_FINE * reach_px), 1, -1, cv2.LINE_8, _FINE_BITS)
        mask &= disc
    return _metered(grey[corner[1] : end[1], corner[0] : end[0]], mask)


def meter_mask(grey: Bytes, mask: NDArray[np.bool_]) -> Metered | None:
    """Return the metering of the pixels of a mask (H, W)."""
    return _metered(grey, mask.astype(np.uint8))


def histogram_of(grey: Bytes) -> NDArray[np.int64]:
    """Return (256,) counts of a picture's greys, on a grid of its pixels."""
    every = max(1, grey.shape[1] // _COUNTED_ACROSS)
    return _counts(np.ascontiguousarray(grey[::every, ::every]), None)


def _counts(picture: Bytes, mask: Bytes | None) -> NDArray[np.int64]:
    counts = cv2.calcHist([picture], [0], mask, [256], [0, 256])
    return np.asarray(counts).ravel().astype(np.int64)


def _metered(window: Bytes, inside: Bytes) -> Metered | None:
    """Return the metering of the pixels of a window (H, W) where ``inside`` is not 0."""
    every = max(1, window.size // _COUNTED_PX)
    counts = _counts(window[::every], inside[::every])
    total = int(counts.sum())
    if total < MIN_PIXELS:
        return None
    return Metered(
        mean_grey=float(counts @ np.arange(256) / total),
        clipped=float(counts[WHITE:].sum() / total),
        black=float(counts[: BLACK + 1].sum() / total),
        pixels=total * every,
        low_grey=float(np.searchsorted(np.cumsum(counts), _LOW_SHARE * total)),
    )
