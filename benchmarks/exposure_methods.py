"""The methods of the exposure bench behind one face, and the settings that each may choose from.

Ours and the paper's are given the blade's region and what the camera confirmed, no more. The
published whole-picture methods are given the picture and, generously, the EV that truly exposed it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from config.inspection import Exposure
from perception.baselines.exposure_entropy import KimEntropy
from perception.baselines.exposure_gradient import ShimGradient
from perception.baselines.exposure_metering import MeanMetering
from perception.baselines.exposure_percentile import ZhangPercentile
from perception.exposure import exposure_control
from perception.exposure_control import ExposureControl
from perception.exposure_limits import EvSteps
from perception.metering import Metered, histogram_of, meter_disc, meter_mask
from perception.values import Bytes

OURS = "ours (predictive)"
PAPER = "paper (Algorithm 2)"
PAPER_BEST = "paper, best step"
AUTOMATIC = "camera's automatic"
CLAHE = "automatic + CLAHE, re-implemented"
MIN_EV, MAX_EV = -3.0, 3.0


@dataclass(frozen=True, slots=True, eq=False)
class FrameSeen:
    """What a method is given of one frame."""

    grey: Bytes
    """(H, W)"""
    blade: NDArray[np.bool_]
    """(H, W) where the fitted blade surely is."""
    centre_px: tuple[float, float]
    """Projected foot."""
    ev: float
    """That truly exposed it, for those that are told."""
    stamp_s: float
    spare: bool = False
    """No photo is near: exposures may be tried."""


class Method(Protocol):
    """A controller of exposure."""

    def confirmed(self, ev: float, stamp_s: float) -> None:
        """Hear what the camera says that it is set to."""
        ...

    def update(self, seen: FrameSeen) -> float:
        """Return the EV wanted."""
        ...


class OnBlade:
    """Ours or the paper's: meters the blade."""

    def __init__(self, control: ExposureControl, *, disc: bool) -> None:
        self.control = control
        self._disc = disc
        self._ev = 0.0

    def confirmed(self, ev: float, stamp_s: float) -> None:
        """See `Method`."""
        self.control.confirmed(ev, stamp_s)

    def update(self, seen: FrameSeen) -> float:
        """See `Method`."""
        metered = self._meter(seen)
        if metered is not None:
            histogram = histogram_of(seen.grey)
            self._ev = self.control.update(metered, seen.stamp_s, histogram, spare=seen.spare)
        return self._ev

    def _meter(self, seen: FrameSeen) -> Metered | None:
        if self._disc:
            radius_px = max(Exposure().disc_radius * seen.grey.shape[1], 3.0)
            return meter_disc(seen.grey, np.array(seen.centre_px), radius_px)
        return meter_mask(seen.grey, seen.blade)


class _Picture(Protocol):
    def update(self, grey: Bytes, ev: float) -> float: ...


class OnPicture:
    """A published method: meters the whole picture, thinned."""

    def __init__(self, controller: _Picture) -> None:
        self._controller = controller

    def confirmed(self, ev: float, stamp_s: float) -> None:
        """See `Method`."""

    def update(self, seen: FrameSeen) -> float:
        """See `Method`."""
        every = max(1, seen.grey.shape[1] // 100)
        thinned = np.ascontiguousarray(seen.grey[::every, ::every])
        wanted = self._controller.update(thinned, seen.ev)
        return min(max(wanted, MIN_EV), MAX_EV)


class LeftAlone:
    """The camera's own automatic without any compensation."""

    def confirmed(self, ev: float, stamp_s: float) -> None:
        """See `Method`."""

    def update(self, seen: FrameSeen) -> float:
        """See `Method`."""
        del seen
        return 0.0


def left_alone(manual: bool) -> Method:
    """Return the camera's own automatic."""
    del manual
    return LeftAlone()


#: Makes a method for a camera that is manual or not.
Maker = Callable[[bool], Method]


def ours(manual: bool) -> Method:
    """Return the default of the product."""
    steps = EvSteps.spaced(MIN_EV, MAX_EV, 1 / 3)
    return OnBlade(exposure_control(Exposure(), steps, automatic=not manual), disc=False)


def paper(manual: bool) -> Method:
    """Return Algorithm 2 as published, metering its disc."""
    del manual
    steps = EvSteps.spaced(MIN_EV, MAX_EV, 1 / 3)
    return OnBlade(exposure_control(Exposure(method="step"), steps), disc=True)


def paper_with_step(step_ev: float) -> Maker:
    """Return Algorithm 2 with another k_mu."""

    def make(manual: bool) -> Method:
        del manual
        steps = EvSteps.spaced(MIN_EV, MAX_EV, 1 / 3)
        settings = Exposure(method="step", step_ev=step_ev)
        return OnBlade(exposure_control(settings, steps), disc=True)

    return make


def _mean(share: float, gain: float) -> Maker:
    return lambda _: OnPicture(MeanMetering(share, gain))


def _shim(gain: float, curve: float | None) -> Maker:
    return lambda _: OnPicture(ShimGradient(gain, curve))


def _zhang(rate: float) -> Maker:
    return lambda _: OnPicture(ZhangPercentile(rate))


def _kim(settled: float) -> Maker:
    return lambda _: OnPicture(KimEntropy(MIN_EV, MAX_EV, settled))


#: Rows of the tables and the settings that each chooses the best of.
CHOICES: dict[str, dict[str, Maker]] = {
    OURS: {"default": ours},
    PAPER: {"k = 0.33 EV": paper},
    PAPER_BEST: {f"k = {k:.2f} EV": paper_with_step(k) for k in (1 / 6, 1 / 3, 2 / 3, 1.0)},
    **{
        f"mean {share:.0%}, re-implemented": {
            f"gain {gain:g}": _mean(share, gain) for gain in (0.4, 0.8, 1.4)
        }
        for share in (0.3, 0.5, 0.7)
    },
    "gradient (Shim), re-implemented": {
        f"k_p {gain:g}, {'linear' if curve is None else f'd {curve:g}'}": _shim(gain, curve)
        for gain in (0.2, 0.4, 1.0)
        for curve in (None, 0.1)
    },
    "soft percentile (Zhang), re-implemented": {
        f"rate {rate:g}": _zhang(rate) for rate in (0.1, 0.3, 1.0)
    },
    "entropy (Kim-style), re-implemented": {
        f"settled {settled:g}": _kim(settled) for settled in (0.15, 0.3, 0.6)
    },
}
