"""Run every compiled step once on a drawn rotor, so that no kernel compiles in flight.

The kernels are compiled at their first call and kept on disk; on a new machine that takes some
ten seconds each time a kernel is met. A process calls this before it says that it is ready.
"""

from __future__ import annotations

import math

import numpy as np

from config.presets import load_turbine
from config.settings import Settings
from config.turbine import Turbine
from perception.blade_line import fit_blade_line
from perception.blade_strip import find_strip
from perception.clearance import OccupancyMemory
from perception.estimator import rotor_estimator
from perception.geometry import camera_looking_along, pinhole_matrix
from perception.hub_prior import TowerSurvey
from perception.rotor import Refusal, direction_at
from perception.rotor_motion import RotorMotionWatch
from perception.values import CameraPose, Float

_NORMAL: Float = np.array([0.0, 1.0, 0.0])
_DOWN: Float = np.array([0.0, 0.0, -1.0])


def warm_up_estimation(settings: Settings) -> bool:
    """Run survey, motion watch and rotor estimate once; True when the estimate went through."""
    turbine = load_turbine("windpact-1.5")
    rng = np.random.default_rng(0)
    hub_w = np.array([0.0, -turbine.overhang_m, turbine.hub_height_m])
    points_w = drawn_turbine(turbine, hub_w, rng)
    survey = TowerSurvey(expected_w=np.zeros(3), turbine=turbine)
    watch = RotorMotionWatch(hub_w, _NORMAL, turbine.rotor_radius_m)
    for scan in range(30):
        some = rng.choice(points_w, 3000)
        survey.update(some, 0.1 * scan)
        watch.update(some, 0.1 * scan)
    survey.result()
    watch.result()
    eye_w = hub_w - 20.0 * _NORMAL
    answer = rotor_estimator(settings, turbine).update(
        points_w,
        np.broadcast_to(eye_w, points_w.shape),
        0.0,
        prior_hub_w=hub_w,
        prior_normal_w=_NORMAL,
    )
    return not isinstance(answer, Refusal)


def warm_up_tracking() -> None:
    """Run the occupancy memory, the blade's line and its place in a picture once."""
    turbine = load_turbine("windpact-1.5")
    hub_w = np.array([0.0, -turbine.overhang_m, turbine.hub_height_m])
    points_w = drawn_turbine(turbine, hub_w, np.random.default_rng(0))
    eye_w = hub_w + np.array([0.0, -12.0, -12.0])
    memory = OccupancyMemory()
    for stamp_s in (0.0, 0.1):
        memory.update(points_w, stamp_s, eye_w)
    memory.nearest(eye_w)
    memory.around(eye_w, 30.0)
    tip_w = hub_w + turbine.rotor_radius_m * _DOWN
    fit_blade_line(points_w, eye_w, hub_w, tip_w, 3.0, half_thickness_m=0.3)
    camera = CameraPose(0.0, eye_w, camera_looking_along(_NORMAL))
    find_strip(
        np.zeros((120, 160), np.uint8), eye_w + 12.0 * _NORMAL, _DOWN, camera,
        pinhole_matrix(400.0, 160, 120), chord_m=2.0, thickness_m=0.4, sigma_m=0.5,
    )  # fmt: skip


def drawn_turbine(turbine: Turbine, hub_w: Float, rng: np.random.Generator) -> Float:
    """Return the skin facing south of a rotor, nacelle and tower, (N, 3) metres: a mere sketch."""
    blade = turbine.blade
    parts = []
    for angle in (0.0, 2 * math.pi / 3, 4 * math.pi / 3):
        axis_w = direction_at(angle, _NORMAL, _DOWN)
        aside_w = np.cross(axis_w, _NORMAL)
        share = rng.uniform(0, 1, 4000)
        chord = np.interp(share, blade.span, blade.chord_m)
        across = (rng.uniform(0, 1, 4000) - np.interp(share, blade.span, blade.pitch_axis)) * chord
        bulge = 0.5 * chord * np.interp(share, blade.span, blade.thickness)
        deep = -bulge * np.sqrt(np.maximum(0.0, 1 - (2 * across / np.maximum(chord, 0.1)) ** 2))
        radius = turbine.hub_radius_m + share * turbine.blade_length_m
        parts.append(
            hub_w + radius[:, None] * axis_w + across[:, None] * aside_w + deep[:, None] * _NORMAL
        )
    turn = rng.uniform(math.pi, 2 * math.pi, 4000)
    height = rng.uniform(0, turbine.tower_height_m, 4000)
    radius = 0.5 * np.interp(
        height,
        (0.0, turbine.tower_height_m),
        (turbine.tower_base_diameter_m, turbine.tower_top_diameter_m),
    )
    parts.append(np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1))
    points_w: Float = np.concatenate(parts)
    return points_w + rng.normal(0, 0.01, points_w.shape)
