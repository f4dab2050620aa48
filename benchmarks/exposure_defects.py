"""Contrast-to-noise of known defects: what sigma and entropy cannot be gamed to say.

Discs of 5-20 % less reflectance, 3-30 px across, at random places of the blade.
CNR = |mean(defect) - mean(ring)| / sd(ring) on the 8-bit still; 0 where more than 1 % of the
pixels of defect and ring are clipped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.values import Bytes, Float32

PER_STILL = 8
CONTRAST = (0.05, 0.20)
SIZE_PX = (3.0, 30.0)
#: Outer radius of the ring, in radii of the defect, and a little.
RING = 1.8
MAX_CLIPPED = 0.01
WHITE, BLACK = 253, 2
_TRIES = 200
#: Below this sd (grey) a ring says more of rounding than of noise.
_LEAST_SD = 0.29


@dataclass(frozen=True, slots=True)
class Defect:
    """A disc on the blade."""

    x_px: float
    y_px: float
    radius_px: float
    contrast: float


@dataclass(frozen=True, slots=True)
class Contrast:
    """How one defect shows."""

    cnr: float
    clipped: float


def draw_defects(blade: NDArray[np.bool_], rng: np.random.Generator) -> list[Defect]:
    """Return defects whose rings lie on a blade's mask (H, W)."""
    height, width = blade.shape
    found: list[Defect] = []
    for _ in range(_TRIES):
        if len(found) == PER_STILL:
            break
        radius = 0.5 * float(rng.uniform(*SIZE_PX))
        reach = RING * radius + 3.0
        x, y = rng.uniform(reach, width - reach), rng.uniform(reach, height - reach)
        top, bottom = int(y - reach), int(y + reach) + 1
        clear = all(np.hypot(x - o.x_px, y - o.y_px) > reach + RING * o.radius_px for o in found)
        if clear and blade[top:bottom, int(x - reach) : int(x + reach) + 1].all():
            found.append(Defect(float(x), float(y), radius, float(rng.uniform(*CONTRAST))))
    return found


def with_defects(radiance: Float32, defects: list[Defect]) -> Float32:
    """Return the radiance (H, W) with the defects on it."""
    out = radiance.copy()
    for defect in defects:
        rows, columns, away = _window(defect, out.shape)
        # Edges as wide as a pixel.
        inside = np.clip(defect.radius_px - away + 0.5, 0.0, 1.0)
        out[rows, columns] *= (1.0 - defect.contrast * inside).astype(np.float32)
    return out


def contrast_to_noise(
    grey: Bytes, blade: NDArray[np.bool_], defects: list[Defect], taken: Bytes | None = None
) -> tuple[Contrast, ...]:
    """Return the CNR of each defect in a still (H, W).

    ``taken``: the still before processing: what was clipped when it was taken counts as such.
    """
    found = []
    source = grey if taken is None else taken
    for defect in defects:
        rows, columns, away = _window(defect, grey.shape)
        values = grey[rows, columns].astype(np.float64)
        on_blade = blade[rows, columns]
        inside = (away <= max(defect.radius_px - 0.5, 1.0)) & on_blade
        ring = (away > defect.radius_px + 1.5) & (away <= RING * defect.radius_px + 2.5) & on_blade
        both = source[rows, columns][inside | ring]
        clipped = float(((both >= WHITE) | (both <= BLACK)).mean())
        sd = max(float(values[ring].std()), _LEAST_SD)
        contrast = abs(float(values[inside].mean()) - float(values[ring].mean()))
        found.append(Contrast(0.0 if clipped > MAX_CLIPPED else contrast / sd, clipped))
    return tuple(found)


def _window(defect: Defect, shape: tuple[int, ...]) -> tuple[slice, slice, NDArray[np.float64]]:
    reach = RING * defect.radius_px + 3.0
    top, left = max(0, int(defect.y_px - reach)), max(0, int(defect.x_px - reach))
    bottom = min(shape[0], int(defect.y_px + reach) + 1)
    right = min(shape[1], int(defect.x_px + reach) + 1)
    y, x = np.mgrid[top:bottom, left:right]
    away = np.hypot(x - defect.x_px, y - defect.y_px)
    return slice(top, bottom), slice(left, right), np.asarray(away, np.float64)
