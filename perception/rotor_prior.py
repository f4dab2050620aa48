"""What is known of rotors before any is seen: means and spreads of the fit's parameters."""

from __future__ import annotations

import math

import numpy as np

from config.turbine import Turbine
from perception import rotor_fit_kernel as kernel
from perception.blade_section import SectionTable, generic_sections, published_sections
from perception.values import Float

DEFAULT_RADIUS_M = 50.0
#: Standard deviations of chord, pitch axis, thickness and twist: common to the span, and free along
#: it. The free ones are the spread of the published blades about the generic one.
FREE_SHAPE = ((0.07, 0.09), (0.02, 0.03), (0.08, 0.15), (math.radians(1.0), math.radians(2.5)))
KNOWN_SHAPE = ((0.02, 0.01), (0.015, 0.01), (0.02, 0.03), (math.radians(0.4), math.radians(0.3)))


def sections_of(turbine: Turbine | None, radius_m: float | None) -> tuple[SectionTable, bool]:
    """Return the sections to fit, and whether they are the type's own."""
    if turbine is not None and turbine.shape == "published":
        return published_sections(turbine), True
    if radius_m is None:
        radius_m = turbine.rotor_radius_m if turbine is not None else DEFAULT_RADIUS_M
    return generic_sections(radius_m), False


def station_columns(table: SectionTable) -> Float:
    """Return (S, 5) chord, twist, pitch axis, prebend and shape of the sag."""
    s = np.linspace(0.0, 1.0, len(table.chord_m))
    bend = s**2 * (6 - 4 * s + s**2) / 3  # a cantilever under an even load, 1 at the tip
    return np.stack(
        [table.chord_m, table.twist_rad, table.pitch_axis, table.prebend_m, bend], axis=1
    )


def parameter_prior(published: bool, turbine: Turbine | None, radius: float) -> tuple[Float, Float]:
    """Return the mean (P,) and information matrix (P, P) of the parameters."""
    k = kernel
    mean, sigma = np.zeros(k.PARAMETERS), np.full(k.PARAMETERS, 1e3)
    mean[k.PREBEND] = 1.0
    mean[k.CONE] = math.radians(turbine.cone_deg if published and turbine else 2.5)
    sigma[k.CONE] = math.radians(0.5 if published else 2.0)
    mean[k.SAG] = 0.0175 * radius * radius / 65.0
    sigma[k.SAG] = 0.35 * mean[k.SAG]
    sigma[k.PREBEND] = 0.05 if published else 0.6
    mean[k.PITCH : k.CHORD], sigma[k.PITCH : k.CHORD] = math.radians(45), math.radians(120)
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
        block = slice(first, first + k.KNOTS)
        info[block, block] = np.linalg.inv(spread)
    return mean, info
