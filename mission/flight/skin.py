"""The skin of a measured blade, and which of it a photo shows: the flight's own coverage.

The catalogue's sections are laid along the measured axis at the measured pitch. A side is the skin
that faces its view (at half span) within 45 deg; of it a photo shows what lies in the picture, is
met at 60 deg or less and is near enough for the GSD limit: the definition by which the field
judges on its true mesh. What hides behind another part is not known here; a blade hides its own
far side by its facing alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.settings import Settings
from config.turbine import Turbine
from mission.flight.occlusion import behind_tower
from mission.flight.rotor_model import RotorModel
from mission.flight.sides import BladeFrame, side_view
from perception.blade_section import published_sections
from perception.geometry import camera_looking_along
from perception.values import Float

Mask = NDArray[np.bool_]

SIDES = ("PS", "SS", "LE", "TE")
FACING_COS = math.cos(math.radians(45.0))
INCIDENCE_COS = math.cos(math.radians(60.0))
#: What of a picture is counted on: aim and registration err by a little.
EDGE_SHARE = 0.97


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Where a photo was taken from, in the frame of the measured rotor."""

    eye_w: Float
    """(3,) optical centre, the registered shift of the blade taken off."""
    sight_w: Float
    """(3,) unit, along the optical axis."""
    blur_px: float = 0.0
    """Expected, in pixels of the full picture."""


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """Facets of one side of one blade. World ENU."""

    points_w: Float
    """(N, 3) centres"""
    normals_w: Float
    """(N, 3) unit, outward"""
    areas_m2: Float
    """(N,)"""
    metres: Float
    """(N,) along the pitch axis from the root flange"""

    def seen_in(
        self,
        look: Look,
        settings: Settings,
        model: RotorModel | None = None,
        margin_m: float = 0.0,
    ) -> Mask:
        """Return (N,) which facets a photo shows well enough.

        ``model``: of the turbine, whose tower hides what lies behind it, and ``margin_m`` beside.
        """
        camera = settings.camera
        rotation = camera_looking_along(look.sight_w)
        rays = self.points_w - look.eye_w
        distance = np.sqrt(np.einsum("ij,ij->i", rays, rays))
        in_camera = rays @ rotation
        depth = np.maximum(in_camera[:, 2], 1e-6)
        half_x = 0.5 * EDGE_SHARE * camera.sensor_width_mm / camera.focal_length_mm
        half_y = 0.5 * EDGE_SHARE * camera.sensor_height_mm / camera.focal_length_mm
        facing = -np.einsum("ij,ij->i", rays, self.normals_w)
        pixel_mm = camera.sensor_width_mm / camera.width_px
        reach_m = settings.tracking.max_gsd_mm * camera.focal_length_mm / pixel_mm / 1000.0
        seen: Mask = (
            (in_camera[:, 2] > 0.5)
            & (np.abs(in_camera[:, 0]) <= half_x * depth)
            & (np.abs(in_camera[:, 1]) <= half_y * depth)
            & (facing >= INCIDENCE_COS * distance)
            & (distance <= reach_m)
        )
        rows = np.flatnonzero(seen)
        if model is not None and len(rows):
            eyes_w = np.broadcast_to(look.eye_w, (len(rows), 3))
            seen[rows] = ~behind_tower(eyes_w, self.points_w[rows], model, margin_m)
        return seen

    def share(self, seen: Mask) -> float:
        """Return the share of the side's area in a mask (N,)."""
        whole = float(self.areas_m2.sum())
        return float(self.areas_m2[seen].sum()) / whole if whole > 0 else 0.0


def blade_skin(frame: BladeFrame, turbine: Turbine) -> dict[str, Skin]:
    """Return the four sides of a measured blade; none where its pitch is not known."""
    if frame.pitch_rad is None:
        return {}
    rings, metres = _rings(frame, turbine, frame.pitch_rad)
    closed = np.concatenate([rings, rings[:, :1]], axis=1)
    a, b = closed[:-1, :-1], closed[1:, :-1]
    c, d = closed[1:, 1:], closed[:-1, 1:]
    across = 0.5 * np.cross(c - a, d - b)
    areas = np.linalg.norm(across, axis=2)
    normals = across / np.maximum(areas, 1e-12)[:, :, None]
    centres = (a + b + c + d) / 4
    outward = np.einsum("sij,sij->si", normals, centres - rings[:-1].mean(axis=1)[:, None])
    if float((outward * areas).sum()) < 0:
        normals = -normals
    points, normals = centres.reshape(-1, 3), normals.reshape(-1, 3)
    areas, at = areas.ravel(), np.repeat((metres[:-1] + metres[1:]) / 2, rings.shape[1])
    skins = {}
    for side in SIDES:
        rows = normals @ side_view(frame, side, turbine) >= FACING_COS
        skins[side] = Skin(points[rows], normals[rows], areas[rows], at[rows])
    return skins


def _rings(frame: BladeFrame, turbine: Turbine, pitch_rad: float) -> tuple[Float, Float]:
    """Return the outlines (S, V, 3) along the blade, and their metres (S,)."""
    table = published_sections(turbine)
    count = len(table.chord_m)
    metres = np.linspace(0.0, turbine.blade_length_m, count)
    angles = pitch_rad + table.twist_rad
    cosine, sine = np.cos(angles)[:, None], np.sin(angles)[:, None]
    leading = cosine * frame.rotation_w + sine * frame.upwind_w
    pressure = cosine * frame.upwind_w - sine * frame.rotation_w
    ahead = (table.pitch_axis[:, None] - table.x) * table.chord_m[:, None]
    above = -table.y * table.chord_m[:, None]
    axis = frame.root_w + metres[:, None] * frame.axis_w
    bend = table.prebend_m[:, None] * frame.pressure(pitch_rad)
    rings = (
        (axis + bend)[:, None, :]
        + ahead[:, :, None] * leading[:, None, :]
        + above[:, :, None] * pressure[:, None, :]
    )
    return np.asarray(rings, np.float64), np.asarray(metres, np.float64)
