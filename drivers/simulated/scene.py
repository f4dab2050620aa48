"""The turbine as it really stands, drawn by the seed. Truth: it never leaves the field process."""

from __future__ import annotations

from dataclasses import dataclass

from config.turbine import Turbine

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
