"""The face that both exposure controllers show: a metered frame in, the wanted EV out."""

from __future__ import annotations

from typing import Protocol

from config.inspection import Exposure
from perception.exposure_predictive import PredictiveExposure
from perception.exposure_step import StepExposure


class ExposureControl(Protocol):
    """Keeps the blade's grey in range by EV alone."""

    def update(self, mean_grey: float, clipped: float, ev_of_frame: float, stamp_s: float) -> float:
        """Return the EV wanted after a frame.

        ``mean_grey``: mu_g of the blade's region, 0-255; ``clipped``: share of it saturated;
        ``ev_of_frame``: the EV that this frame was exposed with, not the one last commanded;
        ``stamp_s``: mission time of the frame.
        """
        ...


def exposure_control(
    settings: Exposure, *, min_ev: float = -3.0, max_ev: float = 3.0
) -> ExposureControl:
    """Return the controller that the settings name."""
    if settings.method == "step":
        return StepExposure(settings, min_ev=min_ev, max_ev=max_ev)
    return PredictiveExposure(settings, min_ev=min_ev, max_ev=max_ev)
