"""The turbine as it really stands, drawn by the seed. Truth: it never leaves the field process."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from config.presets import load_turbine
from config.settings import Settings
from config.simulation import Draw
from config.turbine import Turbine
from drivers.simulated.terrain import ground_height_m

Vec3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Scene:
    """World ENU, origin where the tower's axis meets the ground, metres."""

    turbine: Turbine
    """Already scaled."""
    stop_angle_deg: float
    """By the definition of `perception.rotor`, about the true tower axis."""
    nacelle_yaw_deg: float
    """Compass direction into which the rotor faces (upwind); normal points the other way."""
    tilt_deg: float
    cone_deg: float
    pitch_deg: tuple[float, float, float]
    """Blades at stop angle + 0, 120, 240 deg; 0 operating, 90 feathered (LE upwind)."""
    launch_w: Vec3
    """Take-off point."""
    wind_mean_mps: float
    wind_from_deg: float
    prior_error_m: Vec3
    """Added to the tower's position that the mission is told."""


def draw_scene(settings: Settings) -> Scene:
    """Draw the scene of the first site from the seed alone.

    Every random number is drawn whether it is used or not, so that fixing one value leaves the
    others as they were. The rotor roughly faces the wind, as a yawed machine does: whichever of
    nacelle yaw and wind direction is left random follows the other.
    """
    rng = np.random.default_rng(settings.simulation.seed)
    site, truth, wind = settings.sites[0], settings.simulation.truth, settings.simulation.wind
    turbine = load_turbine(site.turbine, site.scale)

    stop = _pick(truth.stop_angle_deg, float(rng.uniform(0.0, 120.0))) % 120.0
    yaw, wind_from = _yaw_and_wind(rng, truth.nacelle_yaw_deg, wind.direction_deg)
    pitch = _pitch(rng, truth.pitch_deg, truth.pitch_spread_deg)
    tilt, cone = rng.uniform(-0.5, 0.5, 2) + np.array([turbine.tilt_deg, turbine.cone_deg])
    bearing_deg = _pick(truth.launch_bearing_deg, float(rng.uniform(0.0, 360.0)))
    if truth.launch_bearing_from_rotor_deg is not None:
        bearing_deg = yaw + truth.launch_bearing_from_rotor_deg
    bearing = math.radians(bearing_deg)
    distance = _pick(
        truth.launch_distance_m, turbine.rotor_radius_m + float(rng.uniform(20.0, 45.0))
    )
    east, north = distance * math.sin(bearing), distance * math.cos(bearing)
    wind_mps = _pick(wind.mean_mps, float(rng.uniform(2.0, 8.0)))
    error_m = _pick(truth.prior_error_m, float(rng.uniform(0.0, 5.0)))
    towards = float(rng.uniform(0.0, 2.0 * math.pi))
    return Scene(
        turbine=turbine,
        stop_angle_deg=stop,
        nacelle_yaw_deg=yaw,
        tilt_deg=float(tilt),
        cone_deg=float(cone),
        pitch_deg=pitch,
        launch_w=(east, north, ground_height_m(east, north, settings.simulation.seed)),
        wind_mean_mps=wind_mps,
        wind_from_deg=wind_from,
        prior_error_m=(error_m * math.cos(towards), error_m * math.sin(towards), 0.0),
    )


def _pick(given: Draw, drawn: float) -> float:
    return drawn if given == "random" else float(given)


def _yaw_and_wind(rng: np.random.Generator, yaw: Draw, wind_from: Draw) -> tuple[float, float]:
    drawn, error = float(rng.uniform(0.0, 360.0)), float(rng.uniform(-10.0, 10.0))
    if yaw == "random":
        yaw_deg = drawn if wind_from == "random" else float(wind_from) - error
    else:
        yaw_deg = float(yaw)
    return yaw_deg % 360.0, _pick(wind_from, yaw_deg + error) % 360.0


def _pitch(rng: np.random.Generator, pitch: Draw, spread_deg: float) -> tuple[float, float, float]:
    """Pitch as met in the field: 40 % at the operating stop, 45 % feathered, the rest between."""
    kind = float(rng.random())
    fine, feathered, between = rng.uniform((0.0, 82.0, 5.0), (5.0, 90.0, 82.0))
    drawn = fine if kind < 0.40 else feathered if kind < 0.85 else between
    a, b, c = np.full(3, _pick(pitch, float(drawn))) + rng.uniform(-spread_deg, spread_deg, 3)
    return float(a), float(b), float(c)
