"""Blade families of the angle bench: planforms and meshes, independent of perception.

Two kinds of blade. Published planforms (`config/turbines`), scaled to 25-65 m and bent away from
their tables; and planforms drawn freely round what such tables span. Sections follow either the
bench's own outline or the synthetic world's. Prebend, droop and stiffness are drawn for each. The
laws here are the bench's own; nothing in `perception` may import them.
Conventions as in `perception.rotor`: pitch 0 operating (LE towards the rotation,
pressure side upwind), 90 feathered (LE upwind).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from config.presets import load_turbine, turbine_names
from config.turbine import BladeShape, Turbine
from drivers.simulated.airfoil_sections import section
from perception.values import Float

DRAWN = "drawn"
"""Name of the freely drawn family."""
DRAWN_SHARE = 0.35
HELD_OUT = ("nrel-1.79-100", "nrel-2.8-127", "iea-10-198", "iea-22-280", DRAWN)
"""Families that gave neither the fit's generic blade nor the calibration of its sigma, and the
drawn one, of which both saw other seeds."""

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
    sag_exponent: float = 2.7
    """Deflection along the span is its power of this: 2 stiff outboard, 3 soft."""
    world_sections: bool = False
    """Sections of the synthetic world instead of the bench's own."""
    model: str = DRAWN
    """The published planform it came from."""

    @property
    def radius_m(self) -> float:
        """Rotor radius without prebend and cone."""
        return self.length_m + self.hub_radius_m


@lru_cache
def published_models() -> tuple[str, ...]:
    """Return the names of the turbines whose blade shape is published."""
    return tuple(n for n in turbine_names() if load_turbine(n).shape == "published")


def draw_planform(rng: np.random.Generator, models: tuple[str, ...] | None = None) -> Planform:
    """Draw a blade of 25-65 m; ``models`` bounds the families (default: all, `DRAWN` included)."""
    chosen = models or (*published_models(), DRAWN)
    others = [m for m in chosen if m != DRAWN]
    drawn = DRAWN in chosen and (not others or rng.random() < DRAWN_SHARE)
    plan = _drawn(rng) if drawn else _published(rng, others[int(rng.integers(len(others)))])
    length = plan.length_m
    # Blades of 60 and 80 m are said to sag 0.9 and 1.5 m; one type is stiffer than another.
    sag = 0.9 * (length / 60.0) ** 1.78 / length * rng.lognormal(0.0, 0.4)
    prebend = rng.uniform(0.0, 0.05) * plan.radius_m * plan.span ** rng.uniform(1.6, 3.4)
    return replace(
        plan,
        prebend_m=np.asarray(prebend, np.float64),
        sag_flap=float(sag),
        sag_edge=float(sag * rng.uniform(0.15, 0.45)),
        sag_exponent=float(rng.uniform(2.0, 3.1)),
        world_sections=bool(rng.random() < 0.5),
    )


def _published(rng: np.random.Generator, model: str) -> Planform:
    """Return a published planform at another length, its columns bent by a few per cent."""
    turbine = load_turbine(model)
    length = rng.uniform(25.0, 65.0)
    scale = length / turbine.blade_length_m
    span = _span()

    def column(values: tuple[float, ...]) -> Float:
        return np.asarray(PchipInterpolator(turbine.blade.span, values)(span), np.float64)

    def bent(size: float) -> Float:
        """A slow random change along the span."""
        knots = rng.normal(0.0, size, 5)
        return np.asarray(np.interp(span, np.linspace(0, 1, 5), knots), np.float64)

    # Large machines have slender blades; at 25-65 m real ones are wider.
    slender = rng.uniform(0.92, 1.12) * (1.15 if turbine.blade_length_m > 90 else 1.0)
    chord = column(turbine.blade.chord_m) * scale * slender * (1 + bent(0.03))
    thickness = column(turbine.blade.thickness)
    thickness = np.where(thickness > 0.95, thickness, thickness * (1 + bent(0.05)))
    axis = column(turbine.blade.pitch_axis)
    axis = axis + np.where(span > 0.03, 1.0, 0.0) * (rng.normal(0, 0.012) + bent(0.012))
    twist = column(turbine.blade.twist_deg) + rng.normal(0, 0.7) + bent(0.7)
    return Planform(
        length,
        turbine.hub_radius_m * scale * rng.uniform(0.9, 1.15),
        span,
        np.maximum(chord, 0.004 * length),
        twist,
        np.clip(thickness, 0.14, 1.0),
        np.zeros(STATIONS),
        axis,
        rng.uniform(0.01, 0.035),
        rng.uniform(0.004, 0.02),
        rng.uniform(0.85, 1.2),
        0.0,
        0.0,
        model=model,
    )


def _span() -> Float:
    return np.asarray(np.linspace(0.0, 1.0, STATIONS) ** 1.15, np.float64)


def _drawn(rng: np.random.Generator) -> Planform:
    """Draw a blade whose proportions span the published reference blades, and some more."""
    length = rng.uniform(25.0, 65.0)
    span = _span()
    peak = rng.uniform(0.13, 0.28)
    root = length * rng.uniform(0.040, 0.062)
    widest = max(length * rng.uniform(0.052, 0.084), 1.12 * root)
    tip = length * rng.uniform(0.004, 0.025)
    rise = 0.5 - 0.5 * np.cos(np.pi * np.clip((span - 0.02) / (peak - 0.02), 0, 1))
    fall = np.clip((1.0 - span) / (1.0 - peak), 0, 1) ** rng.uniform(0.75, 1.5)
    chord: Float = np.where(span < peak, root + (widest - root) * rise, tip + (widest - tip) * fall)
    twist_root, twist_tip = rng.uniform(9.0, 21.0), rng.uniform(-5.0, 0.5)
    late = np.clip((span - 0.08) / 0.92, 0, 1)
    twist = twist_tip + (twist_root - twist_tip) * (1.0 - late) ** rng.uniform(1.6, 4.0)
    thin = rng.uniform(0.33, 0.46)
    thickness: Float = np.interp(
        span,
        [0, 0.03, peak * 0.6, peak, 0.4, 0.7, 1.0],
        [1.0, 1.0, rng.uniform(0.55, 0.85), thin, 0.30, 0.23, rng.uniform(0.16, 0.21)],
    )
    axis: Float = np.interp(
        span,
        [0, 0.03, peak, 0.5, 1.0],
        [0.5, 0.49, rng.uniform(0.25, 0.38), rng.uniform(0.25, 0.42), rng.uniform(0.25, 0.45)],
    )
    return Planform(
        length,
        rng.uniform(0.022, 0.045) * length,
        span,
        chord,
        twist,
        thickness,
        np.zeros(STATIONS),
        axis,
        rng.uniform(0.01, 0.035),
        rng.uniform(0.004, 0.02),
        rng.uniform(0.85, 1.2),
        0.0,
        0.0,
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


def _outline(plan: Planform, k: int) -> Float:
    """Return the (AROUND, 2) outline of a station by the law of its family."""
    thickness = float(plan.thickness[k])
    if not plan.world_sections:
        return section_outline(thickness, plan.camber, plan.trailing_edge, plan.fullness)
    # The world's runs from the trailing edge over the pressure side and is not closed.
    outline = section(thickness)
    around = np.linspace(0, len(outline) - 1, AROUND + 1)[:-1]
    index = np.arange(len(outline))
    columns = [np.interp(around, index, outline[::-1, c]) for c in range(2)]
    return np.stack(columns, axis=1)


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
    bend = plan.span**plan.sag_exponent
    flat = np.array([sense * np.sin(p), -np.cos(p)])  # pressure-side normal, about untwisted
    edge = np.array([-sense * np.cos(p), -np.sin(p)])
    down = np.array(down_bxy)
    sag = plan.length_m * (
        plan.sag_flap * (down @ flat) * flat + plan.sag_edge * (down @ edge) * edge
    )
    for k, s in enumerate(plan.span):
        outline = _outline(plan, k)
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


@dataclass(frozen=True, slots=True)
class TowerShape:
    """A conical tower, as its owner knows it."""

    hub_height_m: float
    height_m: float
    base_diameter_m: float
    top_diameter_m: float


def known_turbine(
    plan: Planform,
    tilt_deg: float,
    cone_deg: float,
    overhang_m: float,
    tower: TowerShape,
    rng: np.random.Generator,
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
        hub_height_m=tower.hub_height_m,
        rotor_diameter_m=2 * plan.radius_m,
        blade_length_m=plan.length_m,
        hub_radius_m=plan.hub_radius_m,
        tilt_deg=tilt_deg,
        cone_deg=cone_deg,
        overhang_m=overhang_m,
        tower_height_m=tower.height_m,
        tower_base_diameter_m=tower.base_diameter_m,
        tower_top_diameter_m=tower.top_diameter_m,
        blade=shape,
    )
