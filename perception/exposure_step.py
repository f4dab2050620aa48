"""Exposure by fixed steps: Algorithm 2 of Shi et al. 2025, as printed.

A frame brighter than mu_max lowers the exposure gamma by k_mu, one darker than mu_min raises it.
Gamma is the value last commanded, so that with frames of latency it steps on before it sees what
it did: kept so, as the baseline that it is.
"""

from __future__ import annotations

from config.inspection import Exposure


class StepExposure:
    """Algorithm 2, lines 8 to 13."""

    def __init__(self, settings: Exposure, *, min_ev: float = -3.0, max_ev: float = 3.0) -> None:
        """Start without a gamma: the first frame brings it."""
        self._settings = settings
        self._min_ev = min_ev
        self._max_ev = max_ev
        self._gamma_ev: float | None = None

    def update(self, mean_grey: float, clipped: float, ev_of_frame: float, stamp_s: float) -> float:
        """Return gamma after one frame; see `perception.exposure.ExposureControl`."""
        del clipped, stamp_s  # the paper looks at the mean alone
        gamma = ev_of_frame if self._gamma_ev is None else self._gamma_ev
        if mean_grey > self._settings.max_grey:
            gamma -= self._settings.step_ev
        elif mean_grey < self._settings.min_grey:
            gamma += self._settings.step_ev
        # Clamped where it is kept, so that it does not wind up beyond what the camera can do.
        self._gamma_ev = min(max(gamma, self._min_ev), self._max_ev)
        return self._gamma_ev
