"""What one photo shows of a blade, how far apart photos may lie, and how fast one may fly.

The camera keeps its horizon level. A blade at an angle in the picture is seen along a slanted line,
so the footprint depends on how the blade lies as well as on the distance.
"""

from __future__ import annotations

import math

import numpy as np

from config.settings import Settings
from perception.geometry import camera_looking_along
from perception.values import Float

#: The skin lies before the blade's axis, and the camera before the vehicle's centre.
SKIN_NEARER_M = 0.8
#: Of the blur: the vehicle's own speed in gusts on top of the speed wanted, and how fast the
#: gimbal turns while wind turns the airframe (two sigma at 9 m/s of mean wind).
GUST_MPS = 0.25
TURNING_RPS = 0.02
SLOWEST_MPS = 0.4


def gsd_m(distance_m: float, settings: Settings) -> float:
    """Return the ground sample distance in metres per pixel of the full picture."""
    camera = settings.camera
    return distance_m * camera.sensor_width_mm / camera.width_px / camera.focal_length_mm


def footprint_m(axis_w: Float, view_w: Float, distance_m: float, settings: Settings) -> float:
    """Return the length of blade in one photo, along the axis, in metres.

    ``axis_w``: (3,) unit, root to tip. ``view_w``: (3,) unit, from the axis towards the viewer.
    """
    camera = settings.camera
    rotation = camera_looking_along(-view_w)
    right, down = abs(float(rotation[:, 0] @ axis_w)), abs(float(rotation[:, 1] @ axis_w))
    width = distance_m * camera.sensor_width_mm / camera.focal_length_mm
    height = distance_m * camera.sensor_height_mm / camera.focal_length_mm
    return min(width / max(right, 1e-6), height / max(down, 1e-6))


def half_across_m(
    axis_w: Float, view_w: Float, distance_m: float, spacing_m: float, settings: Settings
) -> float:
    """Return how far beside the picture's middle a blade may reach and still be seen whole.

    Across the blade, over the ``spacing_m`` of its length that falls to one photo.
    """
    camera = settings.camera
    rotation = camera_looking_along(-view_w)
    along = np.array([float(rotation[:, 0] @ axis_w), float(rotation[:, 1] @ axis_w)])
    along = np.abs(along) / max(float(np.linalg.norm(along)), 1e-6)
    half = 0.5 * np.array([camera.sensor_width_mm, camera.sensor_height_mm])
    half = half * distance_m / camera.focal_length_mm
    left = np.maximum(half - along * spacing_m / 2, 0.0)
    # Across the blade goes along the picture's other direction.
    return float(min(left[0] / max(along[1], 1e-6), left[1] / max(along[0], 1e-6)))


def photo_metres(from_m: float, to_m: float, footprint: float, overlap: float) -> tuple[float, ...]:
    """Return the metres at which photos are taken so that from..to is covered with overlap."""
    first, last = from_m + 0.45 * footprint, to_m - 0.45 * footprint
    if last <= first:
        return ((from_m + to_m) / 2,)
    count = math.ceil((last - first) / (footprint * (1 - overlap)) - 1e-9) + 1
    return tuple(float(metre) for metre in np.linspace(first, last, count))


def tracking_speed_mps(
    distance_m: float, spacing_m: float, shutter_s: float | None, settings: Settings
) -> float:
    """Return the speed along a blade: bounded by motion blur and by the camera's photo rate.

    Of the blur allowed, what gusts and the gimbal's turning add is left free: the photo is then
    mostly sharp without waiting for a quieter moment.
    """
    camera = settings.camera
    shutter = camera.shutter_s if shutter_s is None else shutter_s
    skin_m = max(distance_m - SKIN_NEARER_M, 1.0)
    fastest = camera.max_blur_px * gsd_m(skin_m, settings) / shutter
    blur = fastest - TURNING_RPS * skin_m - GUST_MPS
    rate = 0.9 * spacing_m / camera.min_interval_s
    return max(SLOWEST_MPS, min(settings.tracking.max_speed_mps, blur, rate))
