"""The true turbine of a virtual mission: how it stands, its solids, and what scans would leave."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from config.turbine import Turbine
from mission.flight.observation import Vec3
from mission.flight.rotor_model import MeasuredBlade, RotorModel, rotor_model
from perception.geometry import vec3
from perception.rotor import blade_angles_deg, direction_at
from perception.values import Float


@dataclass(frozen=True, slots=True)
class Truth:
    """How the turbine really stands. World: ENU, origin at the take-off point."""

    stop_angle_deg: float = 20.0
    pitch_deg: float = 2.0
    upwind_deg: float = 250.0
    """ENU direction (degrees) into which the rotor faces."""
    tower_w: Vec3 = (0.0, 65.0, 0.0)
    pitch_known: bool = True
    turning: bool = False
    side_known_within_deg: float = 360.0
    """Angle off front or back within which sensing tells the rotor's side."""
    still_seen_within_m: float = math.inf
    """Distance from a blade within which sensing tells whether the rotor turns."""
    sigma_deg: float | None = None
    """What an estimate says of itself; None: what it errs by."""
    position_noise_m: float = 0.0
    angle_noise_deg: float = 0.05


def true_model(truth: Truth, turbine: Turbine) -> RotorModel:
    """Return the solids of the true turbine."""
    heading, tilt = math.radians(truth.upwind_deg), math.radians(turbine.tilt_deg)
    normal = np.array(
        [
            -math.cos(heading) * math.cos(tilt),
            -math.sin(heading) * math.cos(tilt),
            -math.sin(tilt),
        ]
    )
    top = np.array(truth.tower_w) + np.array([0.0, 0.0, turbine.hub_height_m])
    hub = top - normal * turbine.overhang_m
    hub[2] = top[2]
    down, cone = np.array([0.0, 0.0, -1.0]), math.radians(turbine.cone_deg)
    blades = []
    for name, angle in zip("ABC", blade_angles_deg(truth.stop_angle_deg), strict=True):
        direction = direction_at(math.radians(angle), normal, down, cone)
        blades.append(MeasuredBlade(name, vec3(direction), truth.pitch_deg))
    return rotor_model(hub, normal, blades, turbine)


def surface(model: RotorModel, turbine: Turbine) -> Float:
    """Return points (N, 3) of the true surface, about a metre apart: what scans would leave."""
    points = []
    for blade in range(len(model.lengths)):
        stations = model.leading.shape[1]
        along = np.linspace(0.0, model.lengths[blade], stations)
        axis = model.roots[blade] + along[:, None] * model.axes[blade]
        lead, chord = model.leading[blade], model.chord[blade]
        points += [axis + lead + share * chord for share in (0.0, 0.5, 1.0)]
    heights = np.arange(1.0, turbine.tower_height_m, 1.0)
    base = model.tower_top_w - model.tower_height_m * model.tower_axis_w
    radius = np.interp(heights, [0.0, turbine.tower_height_m], model.tower_radii)
    for angle in np.linspace(0.0, 2 * np.pi, 6, endpoint=False):
        ring = np.stack([np.cos(angle) * radius, np.sin(angle) * radius, heights], axis=1)
        points.append(base + ring)
    corners = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 1) for z in (-1, 1)])
    points.append(model.box_centre_w + (corners * model.box_half) @ model.box_axes)
    points.append(model.hub_w[None] - model.normal_w * model.hub_radius_m)
    return np.concatenate(points)
