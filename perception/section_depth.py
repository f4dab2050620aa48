"""What the sections along a blade say of the points of its near skin, from where they are seen.

How far behind the skin the axis lies, also where the chord lies aslant to the sight; and where the
blade's middle is, laid by the sections on what is in view of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from perception.values import Float

#: Fewer points than this say nothing of a blade.
MIN_POINTS = 12
#: A chord turned out of the sight's square by more than the first tangent shows one end nearer than
#: the other; by more than the second it is seen edge-on.
SLANTED, EDGE_ON = 0.3, 2.6
#: Of the width that the model shows from here, less than this was not all in view.
WHOLE_WIDTH = 0.8
#: The middle is taken of what lies so near to the foot each way, where there is enough of it, and
#: between these quantiles of what is seen across the blade.
BESIDE_M = 2.0
EXTENT = (0.03, 0.97)
#: Of a section's greatest half thickness, what its skin has on average over the chord.
MEAN_THICKNESS = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class SectionDepth:
    """How far behind the near skin the axis lies, along a blade."""

    metre_m: Float
    """(S,) rising, along the axis from the root."""
    depth_m: Float
    """(S,)"""
    edge: bool
    """The blade is seen edge-on: the nearest of what is seen is its edge."""
    leading_w: Float | None = None
    """(S, 3) from the axis to the chord's leading end, and so `trailing_w`: for a sight aslant."""
    trailing_w: Float | None = None
    round_m: Float | None = None
    """(S,) radius of the edge beyond the chord's end."""
    bend_w: Float | None = None
    """(S, 3) from the straight axis to where a bent blade has its own: for the lateral middle."""


def depth_aslant(
    local: Float, beside: float, side: Float, view: Float, depth: SectionDepth
) -> Float | None:
    """Return how far (N,) behind each point's skin the axis lies, where the chord is aslant.

    ``local``: (N, 3) metres along, aside and deep of the modelled axis; ``beside``: metre of the
    vehicle's foot; ``side``, ``view``: (3,) world units of aside and deep. None where the chord
    lies about square to the sight, or edge-on to a face.
    """
    if depth.leading_w is None or depth.trailing_w is None:
        return None
    if depth.edge:
        nearer = -np.minimum(depth.leading_w @ view, depth.trailing_w @ view)
        edge = nearer if depth.round_m is None else nearer + depth.round_m
        return np.asarray(np.interp(local[:, 0], depth.metre_m, edge), np.float64)
    lead = np.stack([depth.leading_w @ side, depth.leading_w @ view], axis=1)
    trail = np.stack([depth.trailing_w @ side, depth.trailing_w @ view], axis=1)
    aside, deep = (
        [np.interp(local[:, 0], depth.metre_m, end[:, k]) for end in (lead, trail)] for k in (0, 1)
    )
    at = [float(np.interp(beside, depth.metre_m, end[:, 0])) for end in (lead, trail)]
    apart = float(np.interp(beside, depth.metre_m, trail[:, 1] - lead[:, 1]))
    turned = abs(apart) / max(abs(at[1] - at[0]), 1e-6)
    if not SLANTED < turned < EDGE_ON:
        return None
    # The blade hangs beside its model: its chord is laid on the middle of what is seen of it.
    middle, _ = middle_aside(local, beside, side, replace(depth, bend_w=None))
    moved = middle - 0.5 * (at[0] + at[1])
    wide = np.where(np.abs(aside[1] - aside[0]) < 1e-3, 1e-3, aside[1] - aside[0])
    share = np.clip((local[:, 1] - moved - aside[0]) / wide, 0.0, 1.0)
    thick = MEAN_THICKNESS * np.interp(local[:, 0], depth.metre_m, depth.depth_m)
    behind: Float = thick * math.hypot(1.0, turned) - (deep[0] + share * (deep[1] - deep[0]))
    return behind


def _shown(side: Float, metre: Float, depth: SectionDepth | None) -> tuple[Float, Float] | None:
    """Return where the model's sections (N,) have their middle aside, and how wide they show."""
    if depth is None or depth.leading_w is None or depth.trailing_w is None:
        return None
    lead, trail = (
        np.interp(metre, depth.metre_m, end @ side) for end in (depth.leading_w, depth.trailing_w)
    )
    middle = 0.5 * (lead + trail)
    if depth.bend_w is not None:
        middle = middle + np.interp(metre, depth.metre_m, depth.bend_w @ side)
    return middle, np.abs(lead - trail)


def middle_aside(
    local: Float, beside: float, side: Float, depth: SectionDepth | None
) -> tuple[float, float]:
    """Return the blade's middle aside at the foot, and how wide it is seen, in metres.

    ``local``, ``beside``, ``side``: as `depth_aslant` takes them. Beside the vehicle, or, where the
    field of view ends before, farther along: each point is taken from the model's middle at its
    own metre, as a blade tapers, twists and bends. Where clearly less than the model's width is
    seen (the field of view ends there, or a flank is too flat for an echo) one end is missing: the
    blade is laid by the end that then lies nearer to the model.
    """
    near = np.abs(local[:, 0] - beside) < BESIDE_M
    if int(near.sum()) < MIN_POINTS:
        near = np.ones(len(local), bool)
    along, aside = local[near, 0], local[near, 1]
    at = np.array([beside, float(np.median(along))])
    shown, here = _shown(side, along, depth), _shown(side, at, depth)
    expected = 0.0
    if shown is not None and here is not None:
        expected = float(here[0][0])
        aside = aside - shown[0] + expected
    low, high = (float(value) for value in np.quantile(aside, EXTENT))
    middle, width = 0.5 * (low + high), high - low
    if here is not None and width < WHOLE_WIDTH * here[1][1]:
        half = (0.5 - EXTENT[0]) * float(here[1][1])
        middle = min((low + half, high - half), key=lambda end: abs(end - expected))
    return middle, width
