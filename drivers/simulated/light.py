"""Sun, sky and passing clouds. Radiance is in units of a white sheet in full sun (about 1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from config.simulation import Weather
from perception.values import Float32

#: Directions of drift and periods of the clouds' shadow, in mission seconds.
_CLOUD_PERIODS_S = (23.0, 41.0, 97.0)
_TWILIGHT_DEG = 6.0


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """What falls on the scene at one moment."""

    sun_w: Float32
    """(3,) unit, towards the sun."""
    direct: float
    """Irradiance of a surface that faces the sun, from the sun alone."""
    diffuse: float
    """Irradiance of a level surface from the whole sky."""
    cloudiness: float
    """0 blue sky, 1 covered."""
    haze_per_m: float
    """Extinction of the air."""

    def packed(self) -> Float32:
        """Return the values as one array, in the order that the compiled shading reads."""
        values = (*self.sun_w, self.direct, self.diffuse, self.cloudiness, self.haze_per_m)
        return np.array(values, np.float32)


class Sky:
    """The weather of one mission."""

    def __init__(self, weather: Weather, seed: int) -> None:
        self._weather = weather
        self._phases = np.random.default_rng([seed, 0x5C]).uniform(0.0, 2 * math.pi, 3)
        elevation, azimuth = (
            math.radians(weather.sun_elevation_deg),
            math.radians(weather.sun_azimuth_deg),
        )
        level = math.cos(elevation)
        self._sun_w = np.array(
            [level * math.sin(azimuth), level * math.cos(azimuth), math.sin(elevation)], np.float32
        )

    def at(self, t_s: float) -> Light:
        """Return the light at a mission time."""
        weather = self._weather
        height = max(0.0, math.sin(math.radians(weather.sun_elevation_deg)))
        # Air mass by Kasten's rule of thumb; a clear zenith sun keeps 0.87 of its light.
        direct = 1.15 * math.exp(-0.14 / (height + 0.03)) if height > 0.0 else 0.0
        direct *= (1.0 - weather.overcast) * self._sun_through_clouds(t_s)
        day = min(1.0, max(0.004, (weather.sun_elevation_deg + _TWILIGHT_DEG) / 26.0)) ** 1.5
        diffuse = day * (0.16 + 0.22 * weather.overcast)
        haze = 2.0e-4 + weather.fog_extinction_per_m
        return Light(self._sun_w, direct, diffuse, weather.overcast, haze)

    def _sun_through_clouds(self, t_s: float) -> float:
        """Return the share of sun that passes, 0.25-1: long clear spells, edges of 2-4 s."""
        if not self._weather.clouds:
            return 1.0
        wave = sum(
            math.sin(2 * math.pi * t_s / period + phase)
            for period, phase in zip(_CLOUD_PERIODS_S, self._phases, strict=True)
        )
        covered = 1.0 / (1.0 + math.exp(-5.0 * (wave - 1.6 + 1.6 * self._weather.overcast)))
        return 1.0 - 0.75 * covered
