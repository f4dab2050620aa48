"""The face that both exposure controllers show: a metered frame in, the wanted EV out."""

from __future__ import annotations

from abc import ABC, abstractmethod

from perception.exposure_limits import EvSteps
from perception.exposure_response import Histogram
from perception.metering import Metered


class ExposureControl(ABC):
    """Keeps the blade's grey in range by EV alone."""

    def __init__(self, steps: EvSteps, target_grey: float) -> None:
        """``steps``: the EVs that the camera has; ``target_grey``: what the blade shall be."""
        self._steps = steps
        self._target_grey = target_grey
        self._at_limit = False

    @property
    def at_limit(self) -> bool:
        """Whether the camera cannot give what the blade needs."""
        return self._at_limit

    def limit(self, steps: EvSteps) -> None:
        """Take over the EVs that the camera has."""
        self._steps = steps

    def aim(self, target_grey: float) -> None:
        """Aim at another grey than at first: the range moves with it."""
        self._target_grey = target_grey

    @abstractmethod
    def confirmed(self, ev: float, stamp_s: float) -> None:
        """Note an EV that the camera confirmed, and when (mission time).

        Before the first confirmation nothing is known of the camera. When a setting shows in the
        pictures is not told to anybody.
        """

    @abstractmethod
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
