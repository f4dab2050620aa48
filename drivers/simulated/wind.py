"""Wind at the vehicle: a mean that grows with height, Dryden turbulence, and one extreme gust.

Dryden's low-altitude model after MIL-F-8785C: length scales and the ratio of horizontal to
vertical intensity from the height; the horizontal intensity is the site's own turbulence. World
frame ENU, m/s; the wind's vector points to where the air moves.
"""

from __future__ import annotations

import math
from random import Random

from config.simulation import Wind

Vec3 = tuple[float, float, float]

_FOOT_M = 0.3048
#: Power law over open country.
_SHEAR = 0.14
#: Rise and fall of the extreme gust (IEC 61400-1 takes 10.5 s).
_GUST_S = 10.5


class WindField:
    """The wind that the vehicle meets on its way."""

    def __init__(
        self, wind: Wind, mean_mps: float, from_deg: float, hub_height_m: float, random: Random
    ) -> None:
        to_rad = math.radians(from_deg + 180.0)
        self._along = (math.sin(to_rad), math.cos(to_rad))
        self._wind = wind
        self._mean_mps = mean_mps
        self._hub_height_m = hub_height_m
        self._random = random
        self._u = 0.0
        # Two states each of the second-order filters across the wind.
        self._v = [0.0, 0.0]
        self._w = [0.0, 0.0]
        self.max_mps = 0.0

    def mean_at(self, height_m: float) -> float:
        """Return the mean speed at a height above ground, m/s."""
        return float(self._mean_mps * (max(height_m, 2.0) / self._hub_height_m) ** _SHEAR)

    def gust_at(self, now_s: float) -> float:
        """Return the extreme gust, m/s on top of the mean: one minus cosine."""
        phase = (now_s - self._wind.gust_at_s) / _GUST_S
        if self._wind.gust_mps == 0 or not 0 < phase < 1:
            return 0.0
        return self._wind.gust_mps * 0.5 * (1 - math.cos(2 * math.pi * phase))

    def step(self, now_s: float, dt_s: float, height_m: float, velocity_w: Vec3) -> Vec3:
        """Return the wind after ``dt_s`` at a height, for a vehicle that moves through it."""
        mean = self.mean_at(height_m)
        along, across, up = self._turbulence(dt_s, height_m, mean, velocity_w)
        speed = mean + self.gust_at(now_s) + along
        east, north = self._along
        self.max_mps = max(self.max_mps, math.hypot(speed, across))
        return (speed * east - across * north, speed * north + across * east, up)

    def _turbulence(
        self, dt_s: float, height_m: float, mean: float, velocity_w: Vec3
    ) -> tuple[float, float, float]:
        height_ft = min(max(height_m, 3.0), 300.0) / _FOOT_M
        ratio = 0.177 + 0.000823 * height_ft
        sigma_u = self._wind.turbulence * mean
        sigma_w = sigma_u * ratio**0.4
        length_m = height_ft / ratio**1.2 * _FOOT_M
        # Frozen field: it passes with the speed of the vehicle through the air.
        east, north = self._along
        speed = math.hypot(velocity_w[0] - mean * east, velocity_w[1] - mean * north)
        speed = max(speed, 1.0)
        gauss = self._random.gauss
        decay = math.exp(-dt_s * speed / length_m)
        self._u = self._u * decay + sigma_u * math.sqrt(1 - decay * decay) * gauss(0, 1)
        across = _dryden_across(self._v, dt_s * speed / length_m, sigma_u, gauss(0, 1))
        up = _dryden_across(self._w, dt_s * speed / max(height_m, 3.0), sigma_w, gauss(0, 1))
        return self._u, across, up


def _dryden_across(state: list[float], step: float, sigma: float, white: float) -> float:
    """Advance sigma sqrt(L/V) (1 + sqrt(3) s L/V) / (1 + s L/V)^2, driven by unit white noise.

    ``step``: dt V / L. Two equal lags in a row, whose states combine to the numerator.
    """
    decay = math.exp(-step)
    drive = math.sqrt(1 - decay * decay)
    state[0] = state[0] * decay + drive * white
    state[1] = state[1] * decay + (1 - decay) * state[0]
    root3 = math.sqrt(3.0)
    # x0 has unit variance, x1 half of it and E[x0 x1] = 1/2: the sum below has variance 2.
    return sigma * (root3 * state[0] + (1 - root3) * state[1]) / math.sqrt(2.0)
