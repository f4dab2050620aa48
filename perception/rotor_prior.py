"""What is known of rotors before any is seen: means and spreads of the fit's parameters."""

from __future__ import annotations

import math

import numpy as np

from config.turbine import Turbine
from perception import rotor_fit_kernel as kernel
from perception.blade_section import SectionTable, generic_sections, published_sections
from perception.rotor_fit_kernel import Prior
from perception.values import Float

DEFAULT_RADIUS_M = 50.0
PITCH_SPREAD_RAD = math.radians(1.3)
"""Blades of one rotor rarely stand further apart; far more than this and they are let go."""
SPACING_RAD = math.radians(0.1)
"""Of a blade bearing about its even 120 deg."""
SAG_EXPONENT = 2.3
"""Of a tapered cantilever under its own weight; an even one has about 1.6."""
PREBEND_EARLY = (0.010, 0.012)
PREBEND_LATE = (0.022, 0.018)
"""Mean and spread of the amplitudes of s^2 and s^4, as shares of the length, over the published
blades: straight ones to IEA-10-198."""
#: Standard deviations of chord, pitch axis, thickness and twist: common to the span, and free along
#: it. The free ones are the spread of the published blades about the generic one.
FREE_SHAPE = ((0.12, 0.12), (0.03, 0.03), (0.08, 0.12), (1.2, 1.6))
#: Of the twist, degrees at each knot, by which its two shares above are multiplied: the five blades
#: of `blade_section.GENERIC_TWIST_DEG` differ by half more at the root than farther out.
TWIST_SPREAD_DEG = (1.45, 1.35, 1.1, 0.9, 0.9, 1.0, 0.9)
KNOWN_SHAPE = ((0.02, 0.01), (0.015, 0.01), (0.02, 0.03), (math.radians(0.4), math.radians(0.3)))


def sections_of(turbine: Turbine | None, radius_m: float | None) -> tuple[SectionTable, bool]:
    """Return the sections to fit, and whether they are the type's own."""
    if turbine is not None and turbine.shape == "published":
        return published_sections(turbine), True
    if radius_m is None:
        radius_m = turbine.rotor_radius_m if turbine is not None else DEFAULT_RADIUS_M
    return generic_sections(radius_m), False


def station_columns(table: SectionTable, published: bool) -> Float:
    """Return (S, 6) chord, twist, pitch axis, two shapes of prebend, and shape of the sag."""
    s = np.linspace(0.0, 1.0, len(table.chord_m))
    late = table.length_m * s**4
    prebend = table.prebend_m if published else table.length_m * s**2
    return np.stack(
        [table.chord_m, table.twist_rad, table.pitch_axis, prebend, late, s**SAG_EXPONENT], axis=1
    )


def parameter_prior(published: bool, turbine: Turbine | None, length_m: float) -> Prior:
    """Return what is known of the parameters before a cloud is seen."""
    k = kernel
    mean, sigma = np.zeros(k.PARAMETERS), np.full(k.PARAMETERS, 1e3)
    mean[k.CONE] = math.radians(turbine.cone_deg if published and turbine else 2.5)
    sigma[k.CONE] = math.radians(0.5 if published else 2.0)
    mean[k.PREBEND], sigma[k.PREBEND] = (1.0, 0.05) if published else PREBEND_EARLY
    mean[k.BEND], sigma[k.BEND] = (0.0, 0.002) if published else PREBEND_LATE
    # Of what the skeleton says of the plane.
    sigma[k.SR], sigma[k.SD] = 0.05, 0.05
    mean[k.SAG] = 0.9 * (length_m / 60.0) ** 1.78
    sigma[k.SAG] = 0.4 * mean[k.SAG]
    mean[k.PITCH : k.SPACING] = math.radians(45)
    sigma[k.PITCH : k.SPACING] = math.radians(120)
    sigma[k.SPACING : k.CHORD] = SPACING_RAD
    info = np.diag(1.0 / sigma**2)
    for first, (together, apart) in zip(
        (k.CHORD, k.AXIS, k.THICK, k.TWIST), KNOWN_SHAPE if published else FREE_SHAPE, strict=True
    ):
        gap = np.abs(np.subtract.outer(k.KNOT_SPAN, k.KNOT_SPAN)) / 0.12
        spread = together**2 + apart**2 * np.exp(-gap) + np.eye(k.KNOTS) * (0.05 * apart) ** 2
        if first in (k.AXIS, k.THICK):  # the root is a circle on its axis
            calm = np.ones(k.KNOTS)
            calm[0] = 0.15
            spread = spread * np.outer(calm, calm)
        if first == k.TWIST and not published:
            uneven = np.deg2rad(TWIST_SPREAD_DEG)
            spread = spread * np.outer(uneven, uneven)
        block = slice(first, first + k.KNOTS)
        info[block, block] = np.linalg.inv(spread)
    return Prior(mean, info, 1.0 / (3.0 * PITCH_SPREAD_RAD**2))
