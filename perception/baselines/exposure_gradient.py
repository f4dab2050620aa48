"""Gradient-based exposure after Shim et al. 2014 / 2018, re-implemented.

The picture is re-mapped by seven gammas; the one under which the most gradient information would
show says whether the exposure is too high or too low. Constants as in BorealHDR (delta 0.06,
lambda 1000); gradients are signed and in floating point, where that code rounds them away.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from perception.values import Bytes, Float32

GAMMAS = (1 / 1.9, 1 / 1.5, 1 / 1.2, 1.0, 1.2, 1.5, 1.9)
DELTA = 0.06
LAMBDA = 1000.0
_SAMPLES = np.linspace(GAMMAS[0], GAMMAS[-1], 100)
#: Sobel's answer to a full step.
_FULL = 4.0 * math.sqrt(2.0)


class ShimGradient:
    """Moves towards the gamma of most gradient information."""

    def __init__(self, gain: float, curve: float | None = 0.75) -> None:
        """``gain``: k_p; ``curve``: d of the 2018 update, None for the linear one of 2014."""
        self._gain = gain
        self._curve = curve

    def update(self, grey: Bytes, ev: float) -> float:
        """Return the EV wanted after a picture (H, W) that was exposed with ``ev``."""
        level = (grey.astype(np.float32) / np.float32(255.0)).astype(np.float32)
        amounts = [_information(np.power(level, np.float32(gamma))) for gamma in GAMMAS]
        fitted = np.polynomial.Polynomial.fit(GAMMAS, amounts, 5)
        best = float(_SAMPLES[int(np.argmax(fitted(_SAMPLES)))])
        half = 0.5 if best >= 1 else 1.0
        if self._curve is None:
            change = half * self._gain * (1.0 - best)
        else:
            d, bend = self._curve, math.atan(1.0 / self._curve)
            change = half * self._gain * d * math.tan((2.0 - best) * bend - bend)
        return ev + math.log2(max(1.0 + change, 0.1))


def _information(level: Float32) -> float:
    """Return the sum of the pixels' gradient information of a picture in [0, 1]."""
    across = cv2.Sobel(level, cv2.CV_32F, 1, 0, ksize=3)
    down = cv2.Sobel(level, cv2.CV_32F, 0, 1, ksize=3)
    strength = np.sqrt(across * across + down * down) / _FULL
    above = strength[strength >= DELTA]
    return float(np.log10(LAMBDA * (above - DELTA) + 1.0).sum()) / math.log10(
        LAMBDA * (1.0 - DELTA) + 1.0
    )
