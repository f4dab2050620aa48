"""Which controller exposes the blade: the paper's fixed steps, or ours."""

from __future__ import annotations

from config.inspection import Exposure
from perception.exposure_control import ExposureControl
from perception.exposure_limits import EvSteps
from perception.exposure_predictive import PredictiveExposure
from perception.exposure_step import StepExposure


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
