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


#: Means over five published blades (WindPACT 1.5, NREL-1.72-103, NREL 5 MW, DTU 10 MW, IEA-15-240;
#: the rest are kept for judging the fit). The pitch axis is moved a little towards the tabulated
#: ones among them, since the others' are derived.
GENERIC_SPAN = (0.0, 0.03, 0.06, 0.10, 0.15, 0.20, 0.28, 0.40, 0.60, 0.80, 0.95, 1.0)
GENERIC_CHORD = (
    0.0549, 0.0571, 0.0602, 0.0640, 0.0677, 0.0675, 0.0617, 0.0555, 0.0434, 0.0316, 0.0213, 0.0150,
)  # fmt: skip
GENERIC_TWIST_DEG = (14.9, 14.7, 14.5, 13.8, 12.5, 10.7, 8.0, 4.9, 1.9, -0.3, -1.4, -1.6)
GENERIC_THICKNESS = (1.0, 0.988, 0.893, 0.701, 0.507, 0.410, 0.334, 0.293, 0.240, 0.207, 0.2, 0.2)
GENERIC_AXIS = (0.50, 0.492, 0.450, 0.385, 0.330, 0.300, 0.280, 0.280, 0.285, 0.290, 0.290, 0.280)


def generic_sections(radius_m: float) -> SectionTable:
    """Return the middle of published blades, scaled to a rotor radius; straight."""
    length = radius_m / 1.033
    s = np.linspace(0.0, 1.0, STATIONS)
    chord = length * np.interp(s, GENERIC_SPAN, GENERIC_CHORD)
    twist = np.deg2rad(np.interp(s, GENERIC_SPAN, GENERIC_TWIST_DEG))
    axis = np.interp(s, GENERIC_SPAN, GENERIC_AXIS)
    x, y = _outlines(np.interp(s, GENERIC_SPAN, GENERIC_THICKNESS), 0.02)
    return SectionTable(length, radius_m - length, chord, twist, axis, np.zeros(STATIONS), x, y)


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


def section_outlines(thickness: Float) -> tuple[Float, Float]:
    """Return the outlines of (S,) relative thicknesses: x, y of shape (S, VERTICES), in chords."""
    return _outlines(thickness, 0.02)


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
