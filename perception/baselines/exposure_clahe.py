"""Contrast-limited adaptive histogram equalisation after the shot (Tan and Zhang 2022).

Re-implemented: median, then CLAHE; clip limit and tiles are not in what of the paper could be
read, so that common ones are taken. What the exposure lost, no processing brings back.
"""

from __future__ import annotations

import cv2
import numpy as np

from perception.values import Bytes

MEDIAN_PX = 3
TILES = 8


def equalised(grey: Bytes, clip_limit: float) -> Bytes:
    """Return the picture (H, W) after median and CLAHE."""
    calm = cv2.medianBlur(grey, MEDIAN_PX)
    equaliser = cv2.createCLAHE(clipLimit=clip_limit, tileGridSize=(TILES, TILES))
    return np.asarray(equaliser.apply(calm), np.uint8)
