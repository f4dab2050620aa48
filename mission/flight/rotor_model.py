"""The turbine as solids: how far a point is from blades, tower, nacelle and hub.

A blade's section is a stadium: the chord's line between leading and trailing edge (so much of the
chord before the pitch axis as the catalogue says), thick as the section is. Where the pitch is not
known it is the circle that contains every pitch. Everything is inflated by what is not known:
position, droop (growing towards the tip), prebend. World ENU, metres; points are (N, 3).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.turbine import Turbine
from mission.flight.observation import Vec3
from mission.flight.sides import BladeFrame, blade_frame
from perception.geometry import vec3
from perception.turbine_sighting import BladeSolid, TurbineSolid
from perception.values import Float

STATIONS = 64
#: Of a blade: farther out it is away from its neighbours' roots.
INNER_SHARE = 0.4
#: What the fitted rotor may be off by, and how much more per metre of blade (droop, prebend).
BASE_INFLATION_M = 0.3
INFLATION_PER_METRE = 0.012


@dataclass(frozen=True, slots=True, eq=False)
class RotorModel:
    """Solids of one measured turbine; built by `rotor_model`."""

    frames: tuple[BladeFrame, ...]
    hub_w: Float
    normal_w: Float
    roots: Float
    """(B, 3)"""
    axes: Float
    """(B, 3)"""
    lengths: Float
    """(B,)"""
    leading: Float
    """(B, S, 3) from the axis to the stadium's centre line end on the leading side."""
    chord: Float
    """(B, S, 3) from there to the end on the trailing side."""
    chord_sq: Float
    """(B, S)"""
    radius: Float
    """(B, S) half thickness and inflation."""
    tower_top_w: Float
    tower_axis_w: Float
    tower_height_m: float
    tower_radii: tuple[float, float]
    """Base and top, inflated."""
    box_axes: Float
    """(3, 3) rows: along the shaft, sideways, up."""
    box_centre_w: Float
    box_half: Float
    hub_radius_m: float
    rotor_radius_m: float

    def distance(self, points_w: Float) -> Float:
        """Return the distance (N,) of points to the nearest surface; negative inside."""
        distances: Float = self._parts(np.atleast_2d(points_w))[0].min(axis=1)
        return distances

    def part_distances(self, points_w: Float) -> Float:
        """Return distances (N, B + 3) to each blade, tower, nacelle and hub."""
        return self._parts(np.atleast_2d(points_w))[0]

    def nearest(self, point_w: Float) -> tuple[Float, Float]:
        """Return each part's distance (B + 3,) from one point and its nearest point (B + 3, 3)."""
        distances, towards = self._parts(point_w[None, :])
        return distances[0], point_w + towards[0] * distances[0][:, None]

    def beside(self, blade: str) -> tuple[tuple[Vec3, Vec3, float, float], ...]:
        """Return what lies near a blade's root, as truncated cones: ends, radius at each, metres.

        Tower, nacelle, and the inner part of the other blades.
        """
        base, top = self.tower_radii
        foot = self.tower_top_w - self.tower_height_m * self.tower_axis_w
        reach = self.box_half[0] * self.box_axes[0]
        radius = math.hypot(self.box_half[1], self.box_half[2])
        return (
            (vec3(self.tower_top_w), vec3(foot), top, base),
            (vec3(self.box_centre_w - reach), vec3(self.box_centre_w + reach), radius, radius),
            *(self._inner(i) for i, frame in enumerate(self.frames) if frame.name != blade),
        )

    def _inner(self, blade: int) -> tuple[Vec3, Vec3, float, float]:
        """Return a blade's inner part as a cylinder round its axis."""
        inner = slice(0, math.ceil(INNER_SHARE * STATIONS))
        leading, chord = self.leading[blade, inner], self.chord[blade, inner]
        ends = np.linalg.norm(np.stack([leading, leading + chord]), axis=2)
        radius = float((ends + self.radius[blade, inner]).max())
        root, axis = self.roots[blade], self.axes[blade]
        return vec3(root), vec3(root + INNER_SHARE * self.lengths[blade] * axis), radius, radius

    def solid(self) -> TurbineSolid:
        """Return the turbine as it was measured, without what the model is inflated by."""
        span: Float = np.linspace(0.0, 1.0, STATIONS, dtype=np.float64)
        base, top = self.tower_radii
        blades = tuple(
            BladeSolid(
                self.roots[k],
                self.axes[k],
                float(self.lengths[k]),
                self.leading[k],
                self.chord[k],
                self.radius[k] - _inflation_m(span, float(self.lengths[k])),
            )
            for k in range(len(self.lengths))
        )
        return TurbineSolid(
            self.hub_w,
            self.hub_radius_m - BASE_INFLATION_M,
            blades,
            self.tower_top_w,
            self.tower_axis_w,
            self.tower_height_m,
            (base - BASE_INFLATION_M, top - BASE_INFLATION_M),
        )

    def _parts(self, points: Float) -> tuple[Float, Float]:
        """Return distances (N, P) and unit vectors (N, P, 3) from the points to each part."""
        blades = self._to_blades(points)
        others = (self._to_tower(points), self._to_box(points), self._to_hub(points))
        vectors = np.concatenate([blades[0], *(o[0][:, None, :] for o in others)], axis=1)
        radii = np.concatenate([blades[1], *(o[1][:, None] for o in others)], axis=1)
        norm = np.sqrt(np.einsum("npk,npk->np", vectors, vectors))
        unit = vectors / np.maximum(norm, 1e-9)[:, :, None]
        return norm - radii, unit

    def _to_blades(self, points: Float) -> tuple[Float, Float]:
        relative = points[:, None, :] - self.roots
        along = np.einsum("nbk,bk->nb", relative, self.axes)
        along = np.minimum(np.maximum(along, 0.0), self.lengths)
        station = (along * ((STATIONS - 1) / self.lengths) + 0.5).astype(np.intp)
        blade = np.arange(len(self.lengths))
        relative = relative - along[:, :, None] * self.axes - self.leading[blade, station]
        chord = self.chord[blade, station]
        share = np.einsum("nbk,nbk->nb", relative, chord) / self.chord_sq[blade, station]
        share = np.minimum(np.maximum(share, 0.0), 1.0)
        return share[:, :, None] * chord - relative, self.radius[blade, station]

    def _to_tower(self, points: Float) -> tuple[Float, Float]:
        relative = points - self.tower_top_w
        below = np.clip(-(relative @ self.tower_axis_w), 0.0, self.tower_height_m)
        base, top = self.tower_radii
        radius = top + (base - top) * below / self.tower_height_m
        return -relative - below[:, None] * self.tower_axis_w, radius

    def _to_box(self, points: Float) -> tuple[Float, Float]:
        local = (points - self.box_centre_w) @ self.box_axes.T
        clipped = np.clip(local, -self.box_half, self.box_half)
        return (clipped - local) @ self.box_axes, np.zeros(len(points))

    def _to_hub(self, points: Float) -> tuple[Float, Float]:
        return self.hub_w - points, np.full(len(points), self.hub_radius_m)


@dataclass(frozen=True, slots=True)
class MeasuredBlade:
    """What the model needs of a blade."""

    name: str
    direction_w: tuple[float, float, float]
    pitch_deg: float | None


def rotor_model(
    hub_w: Float,
    normal_w: Float,
    blades: Sequence[MeasuredBlade],
    turbine: Turbine,
    tower_w: Float | None = None,
    tower_axis_w: Float | None = None,
) -> RotorModel:
    """Build the solids from a measured rotor and the catalogue.

    ``tower_w`` is a point of the measured tower axis; without it the tower stands where the
    catalogue's overhang puts it. The base lies a hub height below the hub.
    """
    normal = normal_w / np.linalg.norm(normal_w)
    frames = tuple(
        blade_frame(b.name, hub_w, normal, np.array(b.direction_w), b.pitch_deg, turbine)
        for b in blades
    )
    sections = [_sections(frame, turbine) for frame in frames]
    axis = np.array([0.0, 0.0, 1.0]) if tower_axis_w is None else tower_axis_w
    top = _tower_top(hub_w, normal, turbine, tower_w, axis)
    forward = np.array([normal[0], normal[1], 0.0])
    forward /= np.linalg.norm(forward)
    side = np.array([-forward[1], forward[0], 0.0])
    # Nacelles stand level, or along the tilted shaft: the box is high enough for both. Where it
    # begins and ends is not published: from the hub on, the longer of two usual layouts.
    box_axes = np.stack([forward, side, np.array([0.0, 0.0, 1.0])])
    begin = 0.5 * turbine.hub_radius_m
    end = max(
        turbine.overhang_m + 0.75 * turbine.nacelle_length_m,
        turbine.hub_radius_m + turbine.nacelle_length_m,
    )
    level = normal[2] * turbine.overhang_m
    half = [
        (end - begin) / 2,
        turbine.nacelle_width_m / 2,
        turbine.nacelle_height_m / 2 + abs(level),
    ]
    return RotorModel(
        frames=frames,
        hub_w=hub_w,
        normal_w=normal,
        roots=np.stack([frame.root_w for frame in frames]),
        axes=np.stack([frame.axis_w for frame in frames]),
        lengths=np.array([frame.length_m for frame in frames]),
        leading=np.stack([s[0] for s in sections]),
        chord=np.stack([s[1] for s in sections]),
        chord_sq=np.maximum(np.stack([(s[1] ** 2).sum(axis=1) for s in sections]), 1e-9),
        radius=np.stack([s[2] for s in sections]),
        tower_top_w=top,
        tower_axis_w=axis,
        tower_height_m=turbine.tower_height_m,
        tower_radii=(
            turbine.tower_base_diameter_m / 2 + BASE_INFLATION_M,
            turbine.tower_top_diameter_m / 2 + BASE_INFLATION_M,
        ),
        box_axes=box_axes,
        box_centre_w=hub_w + forward * (begin + end) / 2 + np.array([0.0, 0.0, level]),
        box_half=np.array(half) + BASE_INFLATION_M,
        hub_radius_m=1.2 * turbine.hub_radius_m + BASE_INFLATION_M,
        rotor_radius_m=turbine.rotor_radius_m,
    )


def _tower_top(
    hub_w: Float, normal: Float, turbine: Turbine, tower_w: Float | None, axis: Float
) -> Float:
    height = hub_w[2] - 0.3 * turbine.nacelle_height_m
    if tower_w is None:
        top = hub_w + normal * turbine.overhang_m
        return np.array([top[0], top[1], height])
    return np.asarray(tower_w + axis * ((height - tower_w[2]) / axis[2]), np.float64)


def _sections(frame: BladeFrame, turbine: Turbine) -> tuple[Float, Float, NDArray[np.float64]]:
    """Return the stadium (leading end, chord, radius) at each station of a blade."""
    shape = turbine.blade
    span: Float = np.linspace(0.0, 1.0, STATIONS, dtype=np.float64)
    chord, twist, thickness, prebend, axis_at = (
        np.interp(span, shape.span, column)
        for column in (
            shape.chord_m, shape.twist_deg, shape.thickness, shape.prebend_m, shape.pitch_axis
        )
    )  # fmt: skip
    inflation = _inflation_m(span, frame.length_m)
    if frame.pitch_rad is None:
        reach = np.maximum(axis_at, 1 - axis_at) * chord + np.abs(prebend)
        nothing = np.zeros((STATIONS, 3))
        return nothing, nothing, reach + inflation
    half = thickness * chord / 2
    ahead = np.maximum(axis_at * chord - half, 0.0)
    behind = np.maximum((1 - axis_at) * chord - half, 0.0)
    angles = frame.pitch_rad + np.radians(twist)
    lead = np.cos(angles)[:, None] * frame.rotation_w + np.sin(angles)[:, None] * frame.upwind_w
    bend = prebend[:, None] * frame.pressure(frame.pitch_rad)
    return bend + ahead[:, None] * lead, -(ahead + behind)[:, None] * lead, half + inflation


def _inflation_m(span: Float, length_m: float) -> Float:
    """Return what a blade is inflated by at shares of its span."""
    inflation: Float = BASE_INFLATION_M + INFLATION_PER_METRE * span * length_m
    return inflation
