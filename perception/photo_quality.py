"""Is a photo usable? Blade in view, exposed in range, sharp. Judged on the file as stored."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from perception.metering import WHITE
from perception.values import Bytes

#: Fewer pixels of the blade than this say nothing of it.
LEAST_PIXELS = 60


@dataclass(frozen=True, slots=True)
class PhotoQuality:
    """Figures of the blade region of one picture."""

    mean_grey: float
    sigma_grey: float
    entropy_nats: float
    """Entropy of the grey histogram (the paper's table fits nats)."""
    clipped: float
    """Share of saturated pixels."""
    sharpness: float
    """Variance of the Laplacian of the region."""
    in_range: bool
    blade_grey: float | None = None
    """Mean of all of the blade in the picture, where it is known to be drawn on its edges."""


def judge_photo(
    grey: Bytes,
    centre_px: tuple[float, float],
    radius_px: float,
    range_grey: tuple[float, float],
    blade: Bytes | None = None,
    *,
    whole: bool = False,
) -> PhotoQuality | None:
    """Return the figures of the disc round the blade's foot, or None when it is out of the picture.

    ``grey``: (H, W). ``blade``: (H, W), not 0 where the blade is; what of the disc lies beside it
    is left out. Where too little remains, the foot was thought to be where the blade is not: all
    of the blade counts. ``whole``: the mask is sure enough that all of the blade has to be in range
    besides. The disc is the reference region of Shi et al. 2025, Eq. 5, on the still.
    """
    height, width = grey.shape
    left, right = int(centre_px[0] - radius_px), int(centre_px[0] + radius_px) + 1
    top, bottom = int(centre_px[1] - radius_px), int(centre_px[1] + radius_px) + 1
    if right <= 0 or bottom <= 0 or left >= width or top >= height:
        return None
    x0, y0 = max(0, left), max(0, top)
    window = grey[y0 : min(height, bottom), x0 : min(width, right)]
    rows, columns = np.ogrid[: window.shape[0], : window.shape[1]]
    inside = (columns + x0 - centre_px[0]) ** 2 + (rows + y0 - centre_px[1]) ** 2 <= radius_px**2
    if blade is not None:
        on_blade = inside & (blade[y0 : min(height, bottom), x0 : min(width, right)] > 0)
        if np.count_nonzero(on_blade) >= LEAST_PIXELS:
            inside = on_blade
        elif np.count_nonzero(blade) >= LEAST_PIXELS:
            window, inside = grey, blade > 0
    values = window[inside]
    if values.size == 0:
        return None
    counts = np.bincount(values, minlength=256)
    share = counts[counts > 0] / values.size
    mean = float(values.mean())
    laplacian = cv2.Laplacian(window, cv2.CV_32F)
    blade_grey = None
    if whole and blade is not None and np.count_nonzero(blade) >= LEAST_PIXELS:
        blade_grey = float(grey[blade > 0].mean())
    low, high = range_grey
    return PhotoQuality(
        mean_grey=mean,
        sigma_grey=float(values.std()),
        entropy_nats=float(-(share * np.log(share)).sum()),
        clipped=float(counts[WHITE:].sum() / values.size),
        sharpness=float(laplacian[inside].var()),
        in_range=low <= mean <= high and (blade_grey is None or low <= blade_grey <= high),
        blade_grey=blade_grey,
    )
