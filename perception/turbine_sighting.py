"""Where the whole turbine stands beside where it was measured, from the returns of a second.

The blade that is flown along shows how far it lies aside and how deep, not how far the vehicle is
along it. Tower and other blades lie across it and do: wherever two of them are in view, all three
components of the position's drift are seen. Each blade is cut in bins; of each, the middle of its
two edges and the depth of its near skin are compared with the measured section, as are the returns
of the tower with its skin. One least-squares step joins them: the drift, the errors of attitude
(which move what is far), and what each part may itself be off by (a blade bends, a rotor is not
measured exactly). What was not seen is left unsure in the answer's covariance.
World ENU, metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from perception.values import Float

#: Before anything is seen; and of attitude: roll and pitch; heading, as it is begun with and as it
#: is told.
OPEN_SIGMA_M = 4.0
TILT_SIGMA_RAD, HEADING_SIGMA_RAD = math.radians(0.5), math.radians(1.2)
OPEN_HEADING_RAD = math.radians(10.0)
#: A part is off by this, and a blade by so much more per metre from its root.
PART_SIGMA_M, BEND_PER_METRE = 0.2, 0.012
#: Along a blade: bins, how many returns each needs, where they begin, as a share of the length.
BIN_M, LEAST_POINTS, FROM_SHARE = 2.0, 8, 0.06
#: A bin's middle and depth are wrong by so much, and the middle by a share of the width, besides.
MIDDLE_SIGMA_M, MIDDLE_SHARE, DEPTH_SIGMA_M = 0.12, 0.08, 0.15
#: A bin narrower than this share of what is expected is cut by the field of view.
LEAST_WIDTH, MOST_WIDTH, WIDTH_SPARE_M = 0.7, 1.3, 0.3
EDGES = (0.03, 0.97)
#: A section shows its near end rather than its face where it is turned more than this share.
EDGE_ON = 0.35
#: Aslant of the blade no middle is seen: at least this sine between sight and axis. Nor from
#: farther.
LEAST_SINE, FARTHEST_M = 0.5, 45.0
#: A blade's end, where the sight is square to it within this tangent, from no farther; what is seen
#: of it ends so much early, is wrong by so much; and so many returns are of the last metres.
TIP_TANGENT, TIP_RANGE_M, TIP_EARLY_M, TIP_SIGMA_M = 0.4, 20.0, 0.3, 0.4
TIP_POINTS, TIP_PIECE_M, TIP_QUANTILE = 15, 6.0, 0.995
#: The tower: returns this far below its top and above its foot, at least and at most so many,
#: weighing as so many.
TOP_M, FOOT_M, LEAST_TOWER, MOST_TOWER, TOWER_WEIGHS = 6.0, 8.0, 25, 120, 30
TOWER_POINT_SIGMA_M = 0.12
#: Sights of the tower's skin face the vehicle by at least this cosine.
FACING = 0.2
#: Points are taken for a part within these distances, wider at first.
WINDOWS_M = (2.5, 1.2, 0.8)
#: Near tower and hub no blade's points are taken.
SKIN_M, HUB_SHARE = 0.8, 1.6
#: Rows more than this many standard deviations off count less.
_ROBUST = 1.5
#: Answers whose rows disagree by more are none.
MOST_MISFIT = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class BladeSolid:
    """One blade as measured: chord lines with half thicknesses at even stations."""

    root_w: Float
    axis_w: Float
    length_m: float
    leading_w: Float
    """(S, 3) from the axis to the chord line's leading end."""
    chord_w: Float
    """(S, 3) from there to its trailing end."""
    radius_m: Float
    """(S,) half thickness."""


@dataclass(frozen=True, slots=True, eq=False)
class TurbineSolid:
    """The turbine as measured."""

    hub_w: Float
    hub_radius_m: float
    blades: tuple[BladeSolid, ...]
    tower_top_w: Float
    tower_axis_w: Float
    tower_height_m: float
    tower_radii_m: tuple[float, float]
    """Base, top."""


@dataclass(frozen=True, slots=True, eq=False)
class TurbineSighting:
    """How far the whole turbine appears moved in the frame that the vehicle reports in."""

    offset_w: Float
    """(3,) at the vehicle."""
    heading_rad: float
    """By how much it appears turned about the vehicle, counter-clockwise from above."""
    covariance: Float
    """(4, 4) of both."""
    rows: int
    misfit: float
    """Root mean square of the rows, in their own standard deviations."""


class _Rows(NamedTuple):
    """Linear measurements of one part: direction . (drift + ...) = value."""

    part: int
    direction_w: Float
    """(R, 3)"""
    lever_w: Float
    """(R, 3) from the vehicle."""
    metre: Float
    """(R,) along the blade; 0 of the tower."""
    value: Float
    sigma: Float


def sight_turbine(
    points_w: Float, origin_w: Float, solid: TurbineSolid, guess_w: Float
) -> TurbineSighting | None:
    """Return how far the turbine appears moved; None where the returns contradict it, or are few.

    ``points_w``: (N, 3) of about a second; ``origin_w``: (3,) the vehicle; ``guess_w``: (3,)
    """
    offset = np.asarray(guess_w, np.float64)
    found: tuple[Float, Float, int, float] | None = None
    for window_m in WINDOWS_M:
        moved = points_w - offset
        here = origin_w - offset
        tower = _tower_points(moved, solid, window_m)
        rows = [_tower_rows(moved[tower], here, solid)]
        free = _clear_of_tower(moved, solid)
        for k, blade in enumerate(solid.blades):
            rows.append(_blade_rows(moved[free], here, blade, k + 1, window_m))
        seen = [part for part in rows if part is not None]
        if not seen:
            return None
        found = _solve(seen, len(solid.blades) + 1)
        offset = offset + found[0][:3]
    if found is None or found[3] > MOST_MISFIT:
        return None
    told, covariance = _unprejudiced(np.append(offset - guess_w, found[0][3]), found[1])
    return TurbineSighting(guess_w + told[:3], float(told[3]), covariance, found[2], found[3])


def near_turbine(points_w: Float, solid: TurbineSolid) -> NDArray[np.bool_]:
    """Return which points (N,) lie about the rotor and the tower: all others are ground."""
    apart, radius, below = _beside_tower(points_w, solid)
    tower = (apart < radius + WINDOWS_M[0]) & (below < solid.tower_height_m - FOOT_M)
    reach = max(blade.length_m for blade in solid.blades) + 2 * solid.hub_radius_m
    rotor = np.einsum("nk,nk->n", points_w - solid.hub_w, points_w - solid.hub_w) < reach**2
    near: NDArray[np.bool_] = tower | rotor
    return near


# --- tower ----------------------------------------------------------------------------------------


def _tower_points(points: Float, solid: TurbineSolid, window_m: float) -> NDArray[np.bool_]:
    """Return which points (N,) lie near the tower's skin."""
    apart, radius, below = _beside_tower(points, solid)
    near: NDArray[np.bool_] = np.abs(apart - radius) < window_m
    near &= (below > TOP_M) & (below < solid.tower_height_m - FOOT_M)
    return near


def _clear_of_tower(points: Float, solid: TurbineSolid) -> NDArray[np.bool_]:
    """Return which points (N,) are neither the tower's nor the hub's."""
    apart, radius, below = _beside_tower(points, solid)
    clear: NDArray[np.bool_] = (apart > radius + SKIN_M) | (below < -SKIN_M)
    clear &= np.linalg.norm(points - solid.hub_w, axis=1) > HUB_SHARE * solid.hub_radius_m
    return clear


def _beside_tower(points: Float, solid: TurbineSolid) -> tuple[Float, Float, Float]:
    """Return distance from the tower's axis, its radius there, and how far below its top."""
    relative = points - solid.tower_top_w
    below = -(relative @ solid.tower_axis_w)
    off = relative + below[:, None] * solid.tower_axis_w
    base, top = solid.tower_radii_m
    share = np.clip(below / solid.tower_height_m, 0.0, 1.0)
    return np.linalg.norm(off, axis=1), top + (base - top) * share, below


def _tower_rows(points: Float, here: Float, solid: TurbineSolid) -> _Rows | None:
    if len(points) < LEAST_TOWER:
        return None
    points = points[:: max(1, len(points) // MOST_TOWER)]
    relative = points - solid.tower_top_w
    below = -(relative @ solid.tower_axis_w)
    off = relative + below[:, None] * solid.tower_axis_w
    apart, radius, _ = _beside_tower(points, solid)
    outward = off / np.maximum(apart, 1e-6)[:, None]
    towards = here - points
    towards = towards - (towards @ solid.tower_axis_w)[:, None] * solid.tower_axis_w
    towards = towards / np.maximum(np.linalg.norm(towards, axis=1), 1e-6)[:, None]
    facing = np.einsum("nk,nk->n", outward, towards) > FACING
    count = int(facing.sum())
    if count < LEAST_TOWER:
        return None
    sigma = TOWER_POINT_SIGMA_M * math.sqrt(max(1.0, count / TOWER_WEIGHS))
    return _Rows(
        0, outward[facing], points[facing] - here, np.zeros(count),
        (apart - radius)[facing], np.full(count, sigma),
    )  # fmt: skip


# --- blades ---------------------------------------------------------------------------------------


def _blade_rows(
    points: Float, here: Float, blade: BladeSolid, part: int, window_m: float
) -> _Rows | None:
    """Return middle and depth of each bin of a blade that is seen."""
    relative = points - blade.root_w
    along = relative @ blade.axis_w
    off = relative - along[:, None] * blade.axis_w
    half = np.linalg.norm(blade.leading_w + 0.5 * blade.chord_w, axis=1) + 0.5 * np.linalg.norm(
        blade.chord_w, axis=1
    )
    station = np.clip(along / blade.length_m * (len(half) - 1) + 0.5, 0, len(half) - 1).astype(int)
    square = np.einsum("nk,nk->n", off, off)
    reach = half[station] + blade.radius_m[station] + window_m
    near = (square < reach**2) & (along > FROM_SHARE * blade.length_m)
    near &= along < blade.length_m + window_m
    if int(near.sum()) < LEAST_POINTS:
        return None
    along, off = along[near], off[near]
    bins = (along / BIN_M).astype(int)
    found = _tip_row(along, here, blade, window_m)
    for number in np.unique(bins):
        rows = bins == number
        if int(rows.sum()) >= LEAST_POINTS:
            found += _bin_rows(along[rows], off[rows], here, blade, window_m)
    if not found:
        return None
    direction, lever, metre, value, sigma = zip(*found, strict=True)
    return _Rows(
        part, np.stack(direction), np.stack(lever), np.array(metre), np.array(value),
        np.array(sigma),
    )  # fmt: skip


def _tip_row(
    along: Float, here: Float, blade: BladeSolid, window_m: float
) -> list[tuple[Float, Float, float, float, float]]:
    """Return how far beyond its measured length a blade ends, where its end is squarely seen."""
    sight = blade.root_w + blade.length_m * blade.axis_w - here
    ahead = float(sight @ blade.axis_w)
    square = float(np.linalg.norm(sight - ahead * blade.axis_w))
    last = along[along > blade.length_m - TIP_PIECE_M]
    if not abs(ahead) < TIP_TANGENT * square < TIP_TANGENT * TIP_RANGE_M or len(last) < TIP_POINTS:
        return []
    value = _ranked(last, TIP_QUANTILE) + TIP_EARLY_M - blade.length_m
    if abs(value) > window_m:
        return []
    return [(blade.axis_w, sight, 0.0, value, TIP_SIGMA_M)]


def _bin_rows(
    along: Float, off: Float, here: Float, blade: BladeSolid, window_m: float
) -> list[tuple[Float, Float, float, float, float]]:
    metre = float(along.mean())
    centre = blade.root_w + metre * blade.axis_w
    sight = centre - here
    view: Float = sight - float(sight @ blade.axis_w) * blade.axis_w
    square = float(np.linalg.norm(view))
    away = float(np.linalg.norm(sight))
    if away > FARTHEST_M or square < LEAST_SINE * away:
        return []
    view = view / square
    side: Float = np.asarray(np.cross(blade.axis_w, view), np.float64)
    grid = metre / blade.length_m * (len(blade.radius_m) - 1)
    low = min(int(grid), len(blade.radius_m) - 2)
    share = min(grid - low, 1.0)
    lead = (1 - share) * blade.leading_w[low] + share * blade.leading_w[low + 1]
    tail = lead + (1 - share) * blade.chord_w[low] + share * blade.chord_w[low + 1]
    thick = float((1 - share) * blade.radius_m[low] + share * blade.radius_m[low + 1])
    ends = np.array([[lead @ side, lead @ view], [tail @ side, tail @ view]])
    aside, deep = off @ side, off @ view
    found: list[tuple[Float, Float, float, float, float]] = []
    left, right = float(ends[:, 0].min()) - thick, float(ends[:, 0].max()) + thick
    first, last = (_ranked(aside, share) for share in EDGES)
    width, wide = right - left, last - first
    if LEAST_WIDTH * width - WIDTH_SPARE_M < wide < MOST_WIDTH * width + WIDTH_SPARE_M:
        spread = math.hypot(MIDDLE_SIGMA_M, MIDDLE_SHARE * width, width / len(aside))
        found.append((side, sight, metre, (first + last - left - right) / 2, spread))
    chord = ends[1] - ends[0]
    if abs(chord[0]) < EDGE_ON * float(np.linalg.norm(chord)) or float(np.linalg.norm(chord)) < 0.1:
        near_end = float(ends[:, 1].min()) - thick
        value, spread = _ranked(deep, 0.1) - near_end, 2 * DEPTH_SIGMA_M
    else:
        at = np.clip((aside - ends[0, 0]) / chord[0], 0.0, 1.0)
        value = _ranked(deep - (ends[0, 1] + at * chord[1] - thick), 0.5)
        spread = DEPTH_SIGMA_M
    if abs(value) < window_m:
        found.append((view, sight, metre, value, spread))
    return found


def _ranked(values: Float, share: float) -> float:
    """Return the value that a share of the others lies below: a quantile, quickly."""
    rank = round(share * (len(values) - 1))
    return float(np.partition(values, rank)[rank])


# --- all together ---------------------------------------------------------------------------------


def _unprejudiced(told: Float, covariance: Float) -> tuple[Float, Float]:
    """Return drift and heading (4,), and covariance, without what was believed of the heading.

    Who joins sightings over time believes it once, not again with each.
    """
    information: Float = np.asarray(np.linalg.inv(covariance), np.float64)
    seen = information.copy()
    seen[3, 3] += 1 / OPEN_HEADING_RAD**2 - 1 / HEADING_SIGMA_RAD**2
    spread: Float = np.asarray(np.linalg.inv(seen), np.float64)
    return spread @ (information @ told), spread


def _solve(rows: list[_Rows], parts: int) -> tuple[Float, Float, int, float]:
    """Return drift and heading (4,), their covariance, how many rows, and how well they agree.

    The state: drift (3), attitude (3), and of each part an offset (3) and a slope (3).
    """
    size = 6 + 6 * parts
    sigma = np.concatenate(
        [
            np.full(3, OPEN_SIGMA_M),
            [TILT_SIGMA_RAD, TILT_SIGMA_RAD, HEADING_SIGMA_RAD],
            np.tile([PART_SIGMA_M] * 3 + [BEND_PER_METRE] * 3, parts),
        ]
    )
    prior = np.diag(1 / sigma**2)
    blocks, values = [], []
    for part in rows:
        block = np.zeros((len(part.value), size))
        block[:, :3] = part.direction_w
        block[:, 3:6] = np.cross(part.lever_w, part.direction_w)
        at = 6 + 6 * part.part
        block[:, at : at + 3] = part.direction_w
        block[:, at + 3 : at + 6] = part.direction_w * part.metre[:, None]
        blocks.append(block / part.sigma[:, None])
        values.append(part.value / part.sigma)
    matrix: Float = np.concatenate(blocks)
    value: Float = np.concatenate(values)
    weight: Float = np.ones(len(value), np.float64)
    for _ in range(4):
        normal: Float = prior + (matrix * weight[:, None]).T @ matrix
        covariance: Float = np.asarray(np.linalg.inv(normal), np.float64)
        state: Float = covariance @ ((matrix * weight[:, None]).T @ value)
        off: Float = value - matrix @ state
        weight = 1 / (1 + (off / _ROBUST) ** 2)
    misfit = float(np.sqrt((weight * off**2).mean()))
    told = [0, 1, 2, 5]
    return state[told], covariance[np.ix_(told, told)], len(value), misfit
