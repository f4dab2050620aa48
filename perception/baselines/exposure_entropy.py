"""Entropy-weighted gradient and Bayesian optimisation after Kim et al. 2018 / 2020, re-implemented.

The metric weighs each pixel's gradient by the entropy round it and counts what is flat for little;
a Gaussian process over exposures looks for its maximum with the frames as they come. Equations and
constants as far as public code and notes give them, hence 'Kim-style'. Two departures, both in
the method's favour: the entropy is local, where that code takes the whole picture's; and the weight
grows only with more entropy than usual, not with less, which made it prefer black pictures.
"""

from __future__ import annotations

import math
from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.values import Bytes, Float, Float32

BINS, WINDOW_PX = 16, 9
ALPHA, TAU, SATURATED_BELOW = 16.0, 4.0, 0.6
SAMPLES, CANDIDATES = 5, 50
NOISE, LENGTH_EV = 0.2, 1.0
#: Fixed by the acquisition (MAXMI).
_ROOT_C = math.sqrt(math.log(8.0))


class KimEntropy:
    """Searches the exposure of the most entropy-weighted gradient."""

    def __init__(self, min_ev: float, max_ev: float, settled: float) -> None:
        """``settled``: below this sigma of the process the search is over."""
        self._candidates: Float = np.linspace(min_ev, max_ev, CANDIDATES, dtype=np.float64)
        self._settled = settled
        self._samples: deque[tuple[float, float]] = deque(maxlen=SAMPLES)
        self._eta = 1.0

    def update(self, grey: Bytes, ev: float) -> float:
        """Return the EV wanted after a picture (H, W) that was exposed with ``ev``."""
        self._samples.append((ev, entropy_weighted_gradient(grey)))
        mean, variance = self._process()
        reward = mean + _ROOT_C * (np.sqrt(variance + self._eta) - math.sqrt(self._eta))
        chosen = int(np.argmax(reward))
        self._eta += float(variance[chosen])
        if math.sqrt(float(variance[chosen])) <= self._settled:
            self._eta = 1.0
            chosen = int(np.argmax(mean))
        return float(self._candidates[chosen])

    def _process(self) -> tuple[Float, Float]:
        """Return mean and variance at the candidates, of values scaled to one."""
        evs = np.array([ev for ev, _ in self._samples])
        values = np.array([value for _, value in self._samples])
        values = values / max(float(np.abs(values).max()), 1e-9)
        centre = float(values.mean())
        kernel = _kernel(evs, evs) + NOISE**2 * np.eye(len(evs))
        across = _kernel(self._candidates, evs)
        mean = centre + across @ np.linalg.solve(kernel, values - centre)
        variance = 1.0 - np.einsum("ij,ji->i", across, np.linalg.solve(kernel, across.T))
        return np.asarray(mean), np.maximum(variance, 0.0)


def entropy_weighted_gradient(grey: Bytes) -> float:
    """Return the metric of a picture (H, W)."""
    entropy = _local_entropy(grey)
    across = cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=3)
    down = cv2.Sobel(grey, cv2.CV_32F, 0, 1, ksize=3)
    energy = across * across + down * down
    centre, sigma = float(entropy.mean()), max(float(entropy.std()), 1e-3)
    more = np.maximum(entropy - centre, 0.0)
    weights = np.exp(np.minimum(more**2 / (2 * sigma**2), 20.0)) / sigma
    weights /= weights.sum()
    scaled = (entropy - entropy.min()) / max(float(np.ptp(entropy)), 1e-6)
    activation = 2.0 / (1.0 + np.exp(-ALPHA * scaled + TAU)) - 1.0
    flat = scaled < SATURATED_BELOW
    return float((weights * (energy + activation * flat * float(energy.mean()))).sum())


def _kernel(a: Float, b: Float) -> Float:
    return np.asarray(np.exp(-0.5 * ((a[:, None] - b[None]) / LENGTH_EV) ** 2), np.float64)


def _local_entropy(grey: Bytes) -> Float32:
    """Return the entropy in bits of the greys in a window round each pixel."""
    bins: NDArray[np.uint8] = grey // np.uint8(256 // BINS)
    entropy = np.zeros(grey.shape, np.float32)
    for k in np.unique(bins):
        share = cv2.blur((bins == k).astype(np.float32), (WINDOW_PX, WINDOW_PX))
        entropy -= share * np.log2(np.maximum(share, np.float32(1e-6)))
    return entropy
