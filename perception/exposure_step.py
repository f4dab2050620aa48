"""Exposure by fixed steps: Algorithm 2 of Shi et al. 2025, as printed.

A frame brighter than mu_max lowers the exposure gamma by k_mu, one darker than mu_min raises it.
Gamma is the value last commanded, so that with frames of latency it steps on before it sees what
it did: kept so, as the baseline that it is.
"""

from __future__ import annotations

import math

from config.inspection import Exposure
from perception.exposure_control import ExposureControl
from perception.exposure_limits import EvSteps
from perception.exposure_response import Histogram
from perception.metering import Metered


class StepExposure(ExposureControl):
    """Algorithm 2, lines 8 to 13."""

    def __init__(self, settings: Exposure, steps: EvSteps) -> None:
        """Start without a gamma: the camera's first confirmation brings it."""
        super().__init__(steps, settings.target_grey)
        self._settings = settings
        self._gamma_ev: float | None = None

    def confirmed(self, ev: float, stamp_s: float) -> None:
        """Take gamma over from the camera once; see `ExposureControl`."""
        del stamp_s
        if self._gamma_ev is None and math.isfinite(ev):
            self._gamma_ev = ev

    def update(
        self,
        metered: Metered,
        stamp_s: float,
        histogram: Histogram | None = None,
        *,
        spare: bool = False,
    ) -> float:
        """Return gamma after one frame; see `ExposureControl`."""
        del stamp_s, histogram, spare  # the paper looks at the mean alone
        gamma = 0.0 if self._gamma_ev is None else self._gamma_ev
        wanted = gamma
        aside = self._target_grey - self._settings.target_grey
        if metered.mean_grey > self._settings.max_grey + aside:
            wanted = gamma - self._settings.step_ev
        elif metered.mean_grey < self._settings.min_grey + aside:
            wanted = gamma + self._settings.step_ev
        # Clamped where it is kept, so that it does not wind up beyond what the camera can do.
        low, high = self._steps.evs[0], self._steps.evs[-1]
        self._gamma_ev = max(low, min(wanted, high))
        self._at_limit = abs(self._gamma_ev - wanted) > 1e-6
        return self._gamma_ev
