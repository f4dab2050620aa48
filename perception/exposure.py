"""The face that both exposure controllers show: a metered frame in, the wanted EV out."""

from __future__ import annotations

from typing import Protocol

from config.inspection import Exposure
from perception.exposure_limits import EvSteps
from perception.exposure_predictive import PredictiveExposure
from perception.exposure_response import Histogram
from perception.exposure_step import StepExposure
from perception.metering import Metered


class ExposureControl(Protocol):
    """Keeps the blade's grey in range by EV alone."""

    @property
    def at_limit(self) -> bool:
        """Whether the camera cannot give what the blade needs."""
        ...

    def confirmed(self, ev: float, stamp_s: float) -> None:
        """Note an EV that the camera confirmed, and when (mission time).

        Before the first confirmation nothing is known of the camera. When a setting shows in the
        pictures is not told to anybody.
        """
        ...

    def aim(self, target_grey: float) -> None:
        """Aim at another grey than the settings': the range moves with it."""
        ...

    def limit(self, steps: EvSteps) -> None:
        """Take over the EVs that the camera has."""
        ...

    def update(
        self,
        metered: Metered,
        stamp_s: float,
        histogram: Histogram | None = None,
        *,
        spare: bool = False,
    ) -> float:
        """Return the EV wanted after a frame.

        ``metered``: the blade in it; ``stamp_s``: mission time of the frame; ``histogram``: (256,)
        counts of the whole picture (`perception.metering.histogram_of`); ``spare``: no photo is
        near, exposures may be tried.
        """
        ...


def exposure_control(
    settings: Exposure, steps: EvSteps | None = None, *, automatic: bool = False
) -> ExposureControl:
    """Return the controller that the settings name.

    ``steps``: the EVs that the camera has; ``automatic``: EV biases the camera's own automatic.
    """
    known = steps or EvSteps.spaced(-3.0, 3.0, settings.step_ev)
    if settings.method == "step":
        return StepExposure(settings, known)
    return PredictiveExposure(settings, known, automatic=automatic)
