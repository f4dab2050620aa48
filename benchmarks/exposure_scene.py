"""Looks of the exposure bench: upper and lower surface of a blade, root to tip, in four lights.

The turbine, terrain, sky and defects are the simulator's; the blade stands out sideways and is
feathered, so that one surface faces the sky and one the ground, as in the paper's two scenarios.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from config.settings import Settings
from config.simulation import Simulation, TruthDraws, Weather
from config.turbine import Site
from drivers.simulated.light import Light, Sky
from drivers.simulated.mesh import Part
from drivers.simulated.picture import Picture
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.rotor_frame import rotor_frame
from drivers.simulated.scene import draw_scene
from drivers.simulated.texture import draw_defects
from perception.geometry import camera_looking_along
from perception.values import CameraPose, Float, Float32

TURBINE = "nrel-2.3-116"
DISTANCE_M = 12.0
#: Of the line of sight, above the horizon: looking down at the upper surface, up at the lower.
ELEVATION_DEG = {"upper": 40.0, "lower": -30.0}
#: Shares of the blade between which is flown.
FROM, TO = 0.06, 0.97


class Surface(StrEnum):
    """Which side of the blade is looked at."""

    UPPER = "upper"
    LOWER = "lower"


class Lighting(StrEnum):
    """Weather and sun."""

    SUN = "sun"
    OVERCAST = "overcast"
    BACKLIGHT = "backlight"
    CLOUDS = "cloud edges"


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """What stands before the camera."""

    radiance: Float32
    """(H, W)"""
    blade: NDArray[np.bool_]
    """(H, W) the pixels of the blade looked at."""


class Looks:
    """Draws the blade of one seed."""

    def __init__(self, seed: int) -> None:
        truth = TruthDraws(stop_angle_deg=90.0, pitch_deg=88.0, nacelle_yaw_deg="random")
        settings = Settings(
            sites=(Site(name="bench", turbine=TURBINE),),
            simulation=Simulation(seed=seed, truth=truth),
        )
        scene = draw_scene(settings)
        frame = rotor_frame(scene)
        self._seed = seed
        self._axis_w = frame.blades[0].axis_w
        self._hub_w = frame.hub_w
        self._front_w = -frame.normal_w
        self._length_m = scene.turbine.blade_length_m
        self._root_m = scene.turbine.rotor_radius_m - self._length_m
        chord = np.interp(
            np.linspace(0, 1, 50), scene.turbine.blade.span, scene.turbine.blade.chord_m
        )
        defects = draw_defects(self._length_m, chord.astype(np.float32), seed)
        self._picture = Picture(
            Raycaster(scene, settings), settings.camera, defects, self._length_m
        )

    def metre(self, share: float) -> float:
        """Return the distance from the root at a share of the way flown."""
        return (FROM + share * (TO - FROM)) * self._length_m

    def show(
        self, surface: Surface, light: Light, share: float, width_px: int, height_px: int
    ) -> Shown:
        """Draw the look at a share of the way from root to tip."""
        sight = self._sight_w(surface)
        target = self._hub_w + (self._root_m + self.metre(share)) * self._axis_w
        pose = CameraPose(0.0, target - DISTANCE_M * sight, camera_looking_along(sight))
        drawn = self._picture.draw(pose, light, width_px, height_px)
        return Shown(np.minimum(drawn.radiance, 12.0), drawn.part == int(Part.BLADE_0))

    def light(self, surface: Surface, lighting: Lighting, share: float) -> Light:
        """Return the light at a share of the way; only under cloud edges does it change."""
        if lighting is Lighting.BACKLIGHT:
            # The sun stands behind the blade, a little beside it.
            weather = Weather(sun_elevation_deg=24.0, overcast=0.1, clouds=False)
            bearing = self._bearing(self._sight_w(surface)) + math.radians(14.0)
        elif lighting is Lighting.OVERCAST:
            weather = Weather(sun_elevation_deg=45.0, overcast=0.95, clouds=False)
            bearing = self._bearing(self._front_w)
        else:
            weather = Weather(sun_elevation_deg=52.0, overcast=0.1, clouds=False)
            bearing = self._bearing(self._front_w) + math.radians(35.0)
        towards = Weather.model_validate(
            weather.model_dump() | {"sun_azimuth_deg": math.degrees(bearing) % 360.0}
        )
        light = Sky(towards, self._seed).at(0.0)
        if lighting is Lighting.CLOUDS:
            light = replace(light, direct=light.direct * cloud_shadow(share))
        return light

    def _sight_w(self, surface: Surface) -> Float:
        down = math.radians(ELEVATION_DEG[surface.value])
        level = -self._front_w * [1.0, 1.0, 0.0]
        level = level - (level @ self._axis_w) * self._axis_w
        level = level / np.linalg.norm(level)
        sight = math.cos(down) * level - math.sin(down) * np.array([0.0, 0.0, 1.0])
        return np.asarray(sight / np.linalg.norm(sight), np.float64)

    @staticmethod
    def _bearing(direction_w: Float) -> float:
        return math.atan2(float(direction_w[0]), float(direction_w[1]))


def cloud_shadow(share: float) -> float:
    """Return the share of the sun that passes: three clouds, their edges a fraction of a second."""
    covered = 0.0
    for start, end, edge in ((0.15, 0.32, 0.010), (0.45, 0.60, 0.035), (0.75, 0.85, 0.004)):
        into = 1.0 / (1.0 + math.exp(-(share - start) / edge))
        out = 1.0 / (1.0 + math.exp(-(share - end) / edge))
        covered = max(covered, into - out)
    return 1.0 - 0.92 * covered
