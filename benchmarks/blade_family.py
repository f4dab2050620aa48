"""Blade families of the angle bench: drawn planforms and meshes, independent of perception.

The laws here are the bench's own; nothing in `perception` may import them.
Conventions as in `perception.rotor`: pitch 0 operating (LE towards the rotation,
pressure side upwind), 90 feathered (LE upwind).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.turbine import BladeShape, Turbine
from perception.values import Float

STATIONS = 44
AROUND = 32


@dataclass(frozen=True, slots=True, eq=False)
class Planform:
    """Spanwise law of one drawn blade; all columns (STATIONS,), span from 0 (flange) to 1."""

    length_m: float
    hub_radius_m: float
    span: Float
    chord_m: Float
    twist_deg: Float
    thickness: Float
    prebend_m: Float
    pitch_axis: Float
    camber: float
    trailing_edge: float
    """Thickness of the trailing edge as a share of the chord."""
    fullness: float
    """Greatest thickness at 0.3 ** fullness of the chord: 0.24 (1.2) to 0.36 (0.85)."""
    sag_flap: float
    """Tip deflection under its own weight, flatwise, as a share of the length."""
    sag_edge: float

    @property
    def radius_m(self) -> float:
        """Rotor radius without prebend and cone."""
        return self.length_m + self.hub_radius_m


def draw_planform(rng: np.random.Generator) -> Planform:
    """Draw a blade of 25-65 m whose proportions span the published reference blades."""
    length = rng.uniform(25.0, 65.0)
    span: Float = np.asarray(np.linspace(0.0, 1.0, STATIONS) ** 1.15, np.float64)
    peak = rng.uniform(0.14, 0.27)
    root = length * rng.uniform(0.042, 0.060)
    widest = max(length * rng.uniform(0.062, 0.080), 1.15 * root)
    tip = length * rng.uniform(0.004, 0.02)
    rise = 0.5 - 0.5 * np.cos(np.pi * np.clip((span - 0.02) / (peak - 0.02), 0, 1))
    fall = np.clip((1.0 - span) / (1.0 - peak), 0, 1) ** rng.uniform(0.85, 1.35)
    chord: Float = np.where(span < peak, root + (widest - root) * rise, tip + (widest - tip) * fall)
    twist_root, twist_tip = rng.uniform(10.0, 20.0), rng.uniform(-3.0, 0.5)
    late = np.clip((span - 0.08) / 0.92, 0, 1)
    twist = twist_tip + (twist_root - twist_tip) * (1.0 - late) ** rng.uniform(2.0, 4.0)
    thin = rng.uniform(0.34, 0.44)
    thickness: Float = np.interp(
        span,
        [0, 0.03, peak * 0.6, peak, 0.4, 0.7, 1.0],
        [1.0, 1.0, rng.uniform(0.55, 0.75), thin, 0.30, 0.23, rng.uniform(0.16, 0.21)],
    )
    axis: Float = np.interp(
        span,
        [0, 0.03, peak, 0.5, 1.0],
        [0.5, 0.49, rng.uniform(0.29, 0.38), rng.uniform(0.28, 0.42), rng.uniform(0.25, 0.45)],
    )
    sag = 0.0175 * (length / 65.0) * rng.uniform(0.7, 1.3)
    return Planform(
        length,
        rng.uniform(0.025, 0.04) * length,
        span,
        chord,
        twist,
        thickness,
        np.asarray(rng.uniform(0.0, 0.05) * length * span ** rng.uniform(2.0, 3.0), np.float64),
        axis,
        rng.uniform(0.01, 0.035),
        rng.uniform(0.004, 0.02),
        rng.uniform(0.85, 1.2),
        sag,
        sag * rng.uniform(0.15, 0.35),
    )


def section_outline(
    thickness: float, camber: float, trailing_edge: float, fullness: float
) -> Float:
    """Return an outline (AROUND, 2): x from LE (0) to TE (1), y positive to the suction side."""
    angle = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    x = 0.5 + 0.5 * np.cos(angle)
    upper = np.sin(angle) >= 0
    place, x = x, x ** (1.0 / fullness)
    # The nose stays round: its law is the square root of the distance whatever the fullness.
    blunt = np.clip(place / 0.05, 1e-6, 1) ** (0.5 - 0.5 / fullness)
    airfoil = (
        5.0
        * thickness
        * (0.2969 * np.sqrt(x) - 0.1260 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
        + 0.5 * trailing_edge * x
    )
    airfoil = airfoil * blunt
    x = place
    round_half = thickness * np.sqrt(np.clip(x * (1 - x), 0, None))
    share = float(np.clip((thickness - 0.40) / 0.50, 0, 1))  # circular towards the root
    half = share * round_half + (1 - share) * airfoil
    line = (1 - share) * camber * 4 * x * (1 - x)
    return np.stack([x, line + np.where(upper, half, -half)], axis=1)


def blade_mesh(
    plan: Planform, pitch_deg: float, down_bxy: tuple[float, float], sense: float
) -> tuple[Float, NDArray[np.int64]]:
    """Return vertices (V, 3) and triangles of a blade in its own frame.

    Frame: x tangential (counter-clockwise seen from the front), y downwind along the normal,
    z along the undeflected axis from the shaft. ``down_bxy``: gravity's share along x and y;
    ``sense`` is +1 for rotors that turn clockwise seen from upwind.
    """
    rings = []
    p = np.deg2rad(pitch_deg)
    bend = plan.span**2 * (6 - 4 * plan.span + plan.span**2) / 3
    flat = np.array([sense * np.sin(p), -np.cos(p)])  # pressure-side normal, about untwisted
    edge = np.array([-sense * np.cos(p), -np.sin(p)])
    down = np.array(down_bxy)
    sag = plan.length_m * (
        plan.sag_flap * (down @ flat) * flat + plan.sag_edge * (down @ edge) * edge
    )
    for k, s in enumerate(plan.span):
        outline = section_outline(
            float(plan.thickness[k]), plan.camber, plan.trailing_edge, plan.fullness
        )
        a = p + np.deg2rad(plan.twist_deg[k])
        to_le = np.array([-sense * np.cos(a), -np.sin(a)])
        to_ps = np.array([sense * np.sin(a), -np.cos(a)])
        x = (plan.pitch_axis[k] - outline[:, 0]) * plan.chord_m[k]
        y = -outline[:, 1] * plan.chord_m[k]
        # Prebend is built in upwind at operating pitch and turns with the blade.
        pre = plan.prebend_m[k] * np.array([sense * np.sin(p), -np.cos(p)])
        xy = x[:, None] * to_le + y[:, None] * to_ps + pre + sag * bend[k]
        z = np.full(AROUND, plan.hub_radius_m + s * plan.length_m)
        rings.append(np.column_stack([xy, z]))
    rings.append(rings[-1].mean(0, keepdims=True) + np.zeros((AROUND, 3)))
    i, j = np.meshgrid(np.arange(len(rings) - 1), np.arange(AROUND), indexing="ij")
    a, b = i * AROUND + j, i * AROUND + (j + 1) % AROUND
    c, d = a + AROUND, b + AROUND
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([b, d, c], -1)]).reshape(-1, 3)
    return np.concatenate(rings), faces


def known_turbine(
    plan: Planform, tilt_deg: float, cone_deg: float, overhang_m: float, rng: np.random.Generator
) -> Turbine:
    """Return what the owner would know: the type's shape, never exactly the blade's own."""
    chord = plan.chord_m * (1 + rng.uniform(-0.03, 0.03))
    shape = BladeShape(
        span=tuple(float(s) for s in plan.span),
        chord_m=tuple(float(c) for c in chord),
        twist_deg=tuple(float(t) for t in plan.twist_deg + rng.uniform(-0.5, 0.5)),
        thickness=tuple(float(t) for t in plan.thickness),
        prebend_m=tuple(float(b) for b in plan.prebend_m),
        pitch_axis=tuple(float(x) for x in plan.pitch_axis + rng.uniform(-0.02, 0.02)),
    )
    return Turbine(
        name="drawn",
        source="bench draw",
        shape="published",
        rated_mw=2.0,
        hub_height_m=100.0,
        rotor_diameter_m=2 * plan.radius_m,
        blade_length_m=plan.length_m,
        hub_radius_m=plan.hub_radius_m,
        tilt_deg=tilt_deg,
        cone_deg=cone_deg,
        overhang_m=overhang_m,
        tower_height_m=98.0,
        tower_base_diameter_m=4.5,
        tower_top_diameter_m=2.6,
        blade=shape,
    )
