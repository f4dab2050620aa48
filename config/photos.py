"""Photos: when one is kept, and how well the place of what it shows is known."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from config.model import ConfigModel, Fraction, NotNegative, Positive


class Photos(ConfigModel):
    """What a photo must be for it to be kept; what is not is flown again."""

    max_aim_error: Fraction = 0.3
    """Of the blade's foot from the picture's centre, as a share of the picture's width."""
    min_blade_share: Fraction = 0.05
    """Share of the picture that the blade must fill, where its outline is not found in the middle
    of it: a tip seen edge-on fills less."""
    min_mean_grey: Annotated[float, Field(ge=0, le=255)] = 5.0
    """Darker blades are black: nothing can be recovered."""
    max_clipped: Fraction = 0.5
    """Share of the blade's pixels that may be saturated."""
    max_blur_px: Positive = 1.5
    """Motion blur, in pixels of the camera's full size, as the vehicle's and the gimbal's motion
    say; `camera.max_blur_px` is what the flight aims at."""
    min_sharpness: NotNegative = 0.0
    """Variance of the Laplacian of the blade's grey; 0: not judged, for it depends on the camera's
    noise and on what is painted on the blade."""


#: Standard deviations of the noise and of the slow wander of a position, metres.
_NOISE_M = {"rtk": 0.03, "gnss": 0.3}
_WANDER_M = {"rtk": 0.2, "gnss": 1.5}


class Positioning(ConfigModel):
    """How far the vehicle's own position is off: what each photo's uncertainty is made of."""

    method: Literal["rtk", "gnss"] = "rtk"
    noise_m: NotNegative | None = None
    """Fast part; None: 0.03 with RTK, 0.3 without."""
    wander_m: NotNegative | None = None
    """Slow part; None: 0.2 with RTK, 1.5 without."""
    wander_s: Positive = 60.0
    """Time over which the slow part changes."""

    @property
    def noise_sigma_m(self) -> float:
        """Standard deviation of the fast part, per axis."""
        return _NOISE_M[self.method] if self.noise_m is None else self.noise_m

    @property
    def wander_sigma_m(self) -> float:
        """Standard deviation of the slow part, per axis."""
        return _WANDER_M[self.method] if self.wander_m is None else self.wander_m
