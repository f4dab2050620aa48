"""A blade's skin: sections lofted along the pitch axis, twisted, prebent, pitched, coned, sagging.

World ENU, metres. Blade metre 0 is the root flange (blade bearing).
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from config.turbine import Turbine
from drivers.simulated.airfoil_sections import POINTS, arc_lengths, section
from drivers.simulated.mesh import Mesh, Part, build, join, lattice
from drivers.simulated.rotor_frame import BladeFrame
from perception.values import Float

_STATIONS = 90
#: Tip droop, flapwise, of a horizontal blade of 60 m with its chord upright (feathered): 0.9 m at
#: 60 m, 1.5 m at 80 m, as such blades are said to sag.
_FLAP_DROOP_60_M = 0.9
_DROOP_EXPONENT = 1.78
#: A blade is some four times as stiff edgewise as flapwise.
_EDGE_SHARE = 0.25
#: Softer outboard, so steeper than the square law of a uniform cantilever.
_SHAPE_EXPONENT = 2.7


def blade_mesh(turbine: Turbine, hub_w: Float, frame: BladeFrame, part: Part) -> Mesh:
    """Return one blade as it hangs, deflected by its weight, with metre and arc at each vertex."""
    span = _stations()
    shape, stations = turbine.blade, np.asarray(turbine.blade.span)
    chord, twist, thickness, axis_share = (
        PchipInterpolator(stations, np.asarray(column))(span)
        for column in (
            shape.chord_m,
            np.radians(shape.twist_deg),
            shape.thickness,
            shape.pitch_axis,
        )
    )
    centres = hub_w + axis_points(turbine, frame, span)
    rings = np.empty((len(span), POINTS, 3))
    arcs = np.empty((len(span), POINTS))
    for k in range(len(span)):
        outline = section(float(thickness[k]))
        leading, pressure = frame.leading_w(float(twist[k])), frame.pressure_w(float(twist[k]))
        ahead = (axis_share[k] - outline[:, 0]) * chord[k]
        rings[k] = (
            centres[k] + np.outer(ahead, leading) - np.outer(outline[:, 1] * chord[k], pressure)
        )
        arcs[k] = arc_lengths(outline) * chord[k]
    metre = np.repeat((span * turbine.blade_length_m)[:, None], POINTS, axis=1)
    skin = lattice(rings, part, metre=metre, arc=arcs)
    return join([skin, _trailing_edge(rings, metre, arcs, part), _tip(rings, metre, arcs, part)])


def axis_points(turbine: Turbine, frame: BladeFrame, span: Float) -> Float:
    """Return (N, 3) points of the deflected pitch axis from the hub, at shares of the span."""
    prebend = PchipInterpolator(turbine.blade.span, turbine.blade.prebend_m)(span)
    straight = np.outer(turbine.hub_radius_m + span * turbine.blade_length_m, frame.axis_w)
    bent = np.outer(prebend, frame.pressure_w())
    return np.asarray(straight + bent + droop(turbine.blade_length_m, frame, span), np.float64)


def droop(length_m: float, frame: BladeFrame, span: Float) -> Float:
    """Return (N, 3) deflections by gravity at shares of the span.

    Gravity across the blade is split along the chord and across it (at the pitch of the blade);
    the blade is softer across.
    """
    down = np.array([0.0, 0.0, -1.0])
    flap_w, edge_w = frame.pressure_w(), frame.leading_w()
    tip_m = _FLAP_DROOP_60_M * (length_m / 60.0) ** _DROOP_EXPONENT
    tip = tip_m * ((down @ flap_w) * flap_w + _EDGE_SHARE * (down @ edge_w) * edge_w)
    return np.outer(span**_SHAPE_EXPONENT, tip)


def _stations() -> Float:
    """Return the lofted stations: even, and crowded where the tip closes."""
    even = np.linspace(0.0, 0.97, _STATIONS - 12)
    return np.concatenate([even, 1.0 - 0.03 * np.linspace(1.0, 0.0, 13)[1:] ** 1.5])


def _trailing_edge(rings: Float, metre: Float, arcs: Float, part: Part) -> Mesh:
    """The blunt strip between the two sides: vertices of its own, so that the edge stays sharp."""
    strip = rings[:, [0, -1]]
    inside = rings.mean(axis=1)
    outward = (strip.mean(axis=1) - inside).mean(axis=0)
    columns = [0, 0]
    return lattice(strip, part, outward=outward, metre=metre[:, columns], arc=arcs[:, columns])


def _tip(rings: Float, metre: Float, arcs: Float, part: Part) -> Mesh:
    rim = rings[-1]
    vertices = np.concatenate([rim, rim.mean(axis=0, keepdims=True)])
    index = np.arange(len(rim) - 1)
    triangles = np.stack([index, index + 1, np.full_like(index, len(rim))], axis=1)
    corners = vertices[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    if float(faces @ (rim.mean(axis=0) - rings[-2].mean(axis=0))) < 0.0:
        triangles = triangles[:, ::-1]
    return build(
        vertices, triangles, part, np.append(metre[-1], metre[-1, 0]), np.append(arcs[-1], 0.0)
    )
