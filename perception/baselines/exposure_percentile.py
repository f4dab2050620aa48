"""Soft-percentile gradient ascent after Zhang et al. 2017, re-implemented.

The exposure climbs a soft percentile of the gradients' squares by its derivative with respect to
exposure, taken through the camera's response; sRGB is assumed for it, as a calibrated curve stands
in the original. Percentile, exponent, fallback and the penalty of white pixels as in the authors'
group's code; the rate is relative to the metric itself instead of looked up in a table.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from perception.values import Bytes, Float32

PERCENTILE, POWER = 0.7, 5.0
WHITE = 252
#: Means outside of this, or more white than this, fall back to mean metering.
LOW_MEAN, HIGH_MEAN, MUCH_WHITE = 70.0, 190.0, 0.5
MAX_CHANGE_EV = 1.0


class ZhangPercentile:
    """Climbs the soft percentile of gradient energy."""

    def __init__(self, rate: float) -> None:
        """``rate``: EV per relative derivative of the metric."""
        self._rate = rate

    def update(self, grey: Bytes, ev: float) -> float:
        """Return the EV wanted after a picture (H, W) that was exposed with ``ev``."""
        mean = float(grey.mean())
        white = float((grey >= WHITE).mean())
        if mean < LOW_MEAN or mean > HIGH_MEAN or white > MUCH_WHITE:
            change = math.log2(127.0 / max(mean, 1.0))
        else:
            change = self._rate * _relative_derivative(grey)
        return ev + min(max(change, -MAX_CHANGE_EV), MAX_CHANGE_EV)


def _relative_derivative(grey: Bytes) -> float:
    """Return d ln M / d EV of the metric M."""
    level = grey.astype(np.float32)
    across, down = _gradient(level)
    # Grey per EV at each grey, from the assumed response.
    slope = _SLOPES[grey]
    slope_across, slope_down = _gradient(slope)
    energy = across * across + down * down
    derivative = 2.0 * (across * slope_across + down * slope_down)
    blown = grey >= WHITE
    derivative[blown] = -3.0 * np.maximum(np.abs(derivative[blown]), 0.5)
    order = np.argsort(energy, axis=None, kind="stable")
    weights = _weights(energy.size)
    metric = float(weights @ energy.ravel()[order])
    return float(weights @ derivative.ravel()[order]) / max(metric, 1e-3)


def _gradient(values: Float32) -> tuple[Float32, Float32]:
    across = cv2.Scharr(values, cv2.CV_32F, 1, 0, scale=1 / 32)
    down = cv2.Scharr(values, cv2.CV_32F, 0, 1, scale=1 / 32)
    return np.asarray(across, np.float32), np.asarray(down, np.float32)


def _weights(size: int) -> Float32:
    """Return weights of ascending ranks: a soft peak at the percentile."""
    pivot = max(1, int(PERCENTILE * size))
    rank = np.arange(size)
    rising = np.sin(0.5 * np.pi * rank / pivot)
    falling = np.sin(0.5 * np.pi - 0.5 * np.pi * (rank - pivot) / max(size - pivot, 1))
    weights = np.where(rank < pivot, rising, falling) ** POWER
    return np.asarray(weights / weights.sum(), np.float32)


def _slopes() -> Float32:
    """Return grey per EV of the sRGB curve, by grey."""
    level = np.arange(256) / 255.0
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    more = linear * 2.0**0.1
    after = np.where(more <= 0.0031308, 12.92 * more, 1.055 * more ** (1 / 2.4) - 0.055)
    slopes = 2550.0 * (np.minimum(after, 1.0) - level)
    return np.asarray(slopes, np.float32)


_SLOPES: Float32 = _slopes()
