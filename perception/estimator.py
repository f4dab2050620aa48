"""The face that every method of finding the rotor shows."""

from __future__ import annotations

from typing import Protocol

from config.settings import Settings
from config.turbine import Turbine
from perception.rotor import Refusal, RefusalCode, Rotor
from perception.rotor_fit import fit_rotor
from perception.stop_angle import FermatEstimator
from perception.values import Float


class RotorEstimator(Protocol):
    """Finds the rotor in an accumulated cloud; may keep what successive calls share."""

    def update(
        self,
        points_w: Float,
        origins_w: Float,
        stamp_s: float,
        *,
        prior_hub_w: Float | None,
        prior_normal_w: Float | None,
    ) -> Rotor | Refusal:
        """Return the rotor, or why there is none."""
        ...


class RotorFit:
    """Ours: each cloud is fitted by itself."""

    def __init__(self, turbine: Turbine | None, radius_m: float | None = None) -> None:
        self._turbine = turbine
        self._radius_m = radius_m

    def update(
        self,
        points_w: Float,
        origins_w: Float,
        stamp_s: float,
        *,
        prior_hub_w: Float | None,
        prior_normal_w: Float | None,
    ) -> Rotor | Refusal:
        """Return the rotor, or why there is none."""
        return fit_rotor(
            points_w,
            origins_w,
            prior_hub_w=prior_hub_w,
            prior_normal_w=prior_normal_w,
            turbine=self._turbine,
            radius_m=self._radius_m,
            stamp_s=stamp_s,
        )


class Fermat:
    """The paper's method: each call is one iteration of its Algorithm 1."""

    def __init__(self, method: FermatEstimator) -> None:
        self._method = method

    def update(
        self,
        points_w: Float,
        origins_w: Float,
        stamp_s: float,
        *,
        prior_hub_w: Float | None,
        prior_normal_w: Float | None,  # noqa: ARG002 - the paper's method has no use for it
    ) -> Rotor | Refusal:
        """Return the rotor, or why there is none; the method cannot start without a prior hub."""
        if prior_hub_w is None:
            return Refusal(RefusalCode.NO_RING, "the ring search needs a prior hub")
        return self._method.update(points_w, origins_w, prior_hub_w, stamp_s=stamp_s)


def rotor_estimator(
    settings: Settings, turbine: Turbine | None, radius_m: float | None = None
) -> RotorEstimator:
    """Return the estimator that the settings name.

    ``radius_m``: of the rotor, where the turbine's type is not known but its size is.
    """
    if settings.estimation.method == "fermat":
        return Fermat(FermatEstimator(settings.fermat, agree_deg=settings.estimation.agree_deg))
    return RotorFit(turbine, radius_m)
