"""Blade sections as the fit sees them: a spanwise table of outlines in unit chord.

Two laws share one form: a generic family (`generic_sections`), whose scales the fit is free to
change, and a published blade (`published_sections`). The outline of both is our own class
function x^1/2 (1 - x)^m with a thin parabolic camber; m runs from 1/2 (circle) at the root to 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from config.turbine import Turbine
from perception.values import Float

STATIONS = 120
VERTICES = 28
BLUNTNESS = 1.05
"""Exponent m of thin sections: the greatest thickness lies at 1 / (1 + 2 m) of the chord."""


@dataclass(frozen=True, slots=True, eq=False)
class SectionTable:
    """Sections at STATIONS even shares of the blade's length, 0 at the root flange.

    ``x``: (STATIONS, VERTICES) share of the chord from the leading edge, ``y``: the same shape,
    positive to the suction side, shares of the chord. Other columns: (STATIONS,).
    """

    length_m: float
    hub_radius_m: float
    chord_m: Float
    twist_rad: Float
    pitch_axis: Float
    prebend_m: Float
    x: Float
    y: Float


def generic_sections(radius_m: float) -> SectionTable:
    """Return the middle of the published families, scaled to a rotor radius."""
    length = radius_m / 1.033
    s = np.linspace(0.0, 1.0, STATIONS)
    chord = length * np.interp(
        s,
        [0.0, 0.02, 0.06, 0.11, 0.16, 0.21, 0.28, 0.40, 0.60, 0.80, 0.95, 1.0],
        [0.050, 0.050, 0.0535, 0.063, 0.0695, 0.0710, 0.0675, 0.0565, 0.0400, 0.0265, 0.016, 0.010],
    )
    twist = np.deg2rad(-1.5 + 16.0 * (1.0 - np.clip((s - 0.06) / 0.94, 0, 1)) ** 2.8)
    thickness = np.interp(
        s, [0, 0.03, 0.10, 0.2, 0.4, 0.7, 1.0], [1, 1, 0.68, 0.39, 0.3, 0.24, 0.19]
    )
    axis = np.interp(s, [0, 0.03, 0.2, 0.5, 1.0], [0.5, 0.495, 0.335, 0.345, 0.37])
    prebend: Float = np.asarray(0.025 * length * s**2.4, np.float64)
    x, y = _outlines(thickness, 0.02)
    return SectionTable(length, radius_m - length, chord, twist, axis, prebend, x, y)


def published_sections(turbine: Turbine) -> SectionTable:
    """Return the sections of a turbine whose blade shape is known."""
    blade = turbine.blade
    s = np.linspace(0.0, 1.0, STATIONS)

    def column(values: tuple[float, ...]) -> Float:
        return np.asarray(np.interp(s, blade.span, values), np.float64)

    x, y = _outlines(column(blade.thickness), 0.02)
    return SectionTable(
        turbine.blade_length_m,
        turbine.hub_radius_m,
        column(blade.chord_m),
        np.deg2rad(column(blade.twist_deg)),
        column(blade.pitch_axis),
        column(blade.prebend_m),
        x,
        y,
    )


def _outlines(thickness: Float, camber: float) -> tuple[Float, Float]:
    """Return x and y, (STATIONS, VERTICES): from the trailing edge round the nose and back."""
    around = np.linspace(0.0, 2 * np.pi, VERTICES, endpoint=False)
    x = 0.5 + 0.5 * np.cos(around)
    roundness = np.clip((thickness - 0.42) / 0.5, 0, 1)[:, None]
    m = BLUNTNESS - (BLUNTNESS - 0.5) * roundness
    peak = 0.5 / (0.5 + m)
    half = x**0.5 * (1 - x) ** m / (peak**0.5 * (1 - peak) ** m) * 0.5 * thickness[:, None]
    line = (1 - roundness) * camber * 4 * x * (1 - x)
    y = line + np.where(np.sin(around) >= 0, half, -half)
    return np.broadcast_to(x, y.shape).copy(), y
