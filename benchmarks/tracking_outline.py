"""Where a blade truly lies in a photo of the tracking bench."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.tracking_payload import Still
from benchmarks.tracking_senses import TrueBlade
from benchmarks.tracking_trials import Trial
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.rotor_frame import blade_names
from drivers.simulated.still_centre import BLADES, BladeOutline
from perception.values import Float


def outline_of(caster: Raycaster, trial: Trial, name: str) -> BladeOutline:
    """Return the true outline of a blade."""
    part = blade_names(trial.scene.stop_angle_deg).index(name)
    return BladeOutline(caster.mesh, BLADES[part])


def blade_beside(
    trial: Trial, still: Still, blade: TrueBlade, outline: BladeOutline
) -> tuple[float, Float] | None:
    """Return how far the blade's middle lies beside the optical axis, as a tangent, and whereto.

    The second is a unit vector (3,) across blade and sight; None: the picture shows no blade.
    """
    camera, sight = trial.settings.camera, still.rotation_wc[:, 2]
    metre, _ = met_by(blade, still.eye_w, sight)
    across: Float = np.asarray(np.cross(sight, blade.frame.axis_w), np.float64)
    across = across / float(np.linalg.norm(across))
    edges = outline.across(metre, still.eye_w, across, sight)
    half = 0.5 * math.hypot(camera.sensor_width_mm, camera.sensor_height_mm)
    if edges is None or abs(sum(edges) / 2) > half / camera.focal_length_mm:
        return None
    return sum(edges) / 2, across


def met_by(blade: TrueBlade, eye_w: Float, sight_w: Float) -> tuple[float, Float]:
    """Return metre (from the root, along the undeflected axis) and point that a sight meets."""
    rays = blade.centres_w - eye_w
    along = rays @ sight_w
    off = np.linalg.norm(rays - along[:, None] * sight_w, axis=1)
    k = int(off.argmin())
    # Between the stations beside: where the sight is nearest to the line through both.
    low, high = max(k - 1, 0), min(k + 1, len(off) - 1)
    direction = blade.centres_w[high] - blade.centres_w[low]
    direction = direction / np.linalg.norm(direction)
    between = blade.centres_w[k] - eye_w
    b = float(direction @ sight_w)
    share = (b * float(sight_w @ between) - float(direction @ between)) / max(1 - b * b, 1e-6)
    point = blade.centres_w[k] + np.clip(share, -1.0, 1.0) * direction
    return float((point - blade.root_w) @ blade.frame.axis_w), point


def focal_px(trial: Trial) -> float:
    """Return the camera's focal length in pixels of its full picture."""
    camera = trial.settings.camera
    return camera.focal_length_mm / camera.sensor_width_mm * camera.width_px
