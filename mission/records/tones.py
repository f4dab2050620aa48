"""Mean, spread and entropy of a blade's grey in a photo: what the curves along a blade show."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mission.records.photo_record import View

#: Fewer pixels say nothing.
_LEAST_PIXELS = 200


@dataclass(frozen=True, slots=True)
class Tones:
    """Of the blade's pixels: grey 0-255; entropy of their histogram, bits (0-8)."""

    mean: float
    sigma: float
    entropy_bits: float


def tones_of(picture: NDArray[np.uint8], view: View | None, width_px: int) -> Tones | None:
    """Return the tones of a picture (H, W, 3) BGR, stored ``width_px`` wide and since reduced.

    None where the sidecar does not have the blade's outline: sky would be judged with it.
    """
    if view is None or len(view.mask_px) < 3:
        return None
    grey = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)
    mask = np.zeros(grey.shape, np.uint8)
    corners = np.array(view.mask_px) * (grey.shape[1] / max(width_px, 1))
    cv2.fillPoly(mask, [np.round(corners).astype(np.int32)], (255,))
    # The reduced edge is half sky.
    inner = cv2.erode(mask, np.ones((3, 3), np.uint8))
    pixels = grey[inner > 0]
    if len(pixels) < _LEAST_PIXELS:
        return None
    shares = np.bincount(pixels, minlength=256) / len(pixels)
    shares = shares[shares > 0]
    entropy = float(-(shares * np.log2(shares)).sum())
    return Tones(float(pixels.mean()), float(pixels.std()), entropy)
