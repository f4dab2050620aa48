"""Where the blade lies across its axis in a live picture.

What the LiDAR knows of a blade is a decimetre off where it sees few points, and a metre off before
it has seen it at all: a strip drawn there meters the ground beside. The picture itself shows two
edges, somewhere between the blade's thickness and its chord apart, with nothing stronger between
them. Only the place across the axis is looked for, in metres; along it a blade looks much the same.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numba import njit

from perception.projection import project_all
from perception.values import Bytes, CameraPose, Float

#: Half of the stretch of axis that is looked at, as a share of the picture's width.
STRETCH = 0.12
STATIONS = 32
#: The picture is looked at in steps of its width over this.
ACROSS = 320
#: An edge is a difference of greys, at most so much of it counted, over so many steps.
MOST_GREY = 40.0
#: Both edges must be as strong as this (grey), and so many times what is usual in this picture.
LEAST_GREY, LEAST_CONTRAST = 4.0, 3.0
#: The visible width lies between these shares of the thickness and of the chord.
NARROWEST, WIDEST = 0.55, 1.15
#: Where the blade's pitch tells the visible width, it is known to this share of itself and of the
#: chord: the sun draws edges of shadow within the blade that are as sharp as its own.
WIDTH_SHARE, CHORD_SHARE = 0.25, 0.1
#: The axis runs within the blade, this share of the width from its edges at least.
WITHIN = 0.15
#: A blade farther aside than this from where it is expected is less likely: seen by the LiDAR just
#: now, or only aimed at.
SEEN_SIGMA_M, AIMED_SIGMA_M = 0.4, 0.7
#: No blade is farther from there than this many sigmas.
REACH_SIGMAS = 1.5
#: Found places are joined over so many frames, and forgotten after this time (s).
_JOINED, _FORGOTTEN_S = 3, 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Strip:
    """The blade across its expected axis."""

    middle_m: float
    """Along `aside_w`, from the axis that was expected."""
    width_m: float
    aside_w: Float
    """(3,) unit, across blade and sight."""
    contrast: float
    """Strength of the weaker edge over what is usual in this picture."""


def find_strip(
    grey: Bytes,
    near_w: Float,
    axis_w: Float,
    camera: CameraPose,
    matrix: Float,
    *,
    chord_m: float,
    thickness_m: float,
    sigma_m: float,
    width_m: float | None = None,
) -> Strip | None:
    """Return where a blade lies in a picture (H, W), None where its edges do not show.

    ``near_w``: (3,) point of the expected axis that the camera looks at; ``axis_w``: (3,) its unit
    direction; ``chord_m``, ``thickness_m``: the most and the least that the sections thereabouts
    have; ``sigma_m``: how far beside the expected axis the blade may well be; ``width_m``: what it
    ought to show of its width from here, None: not known.
    """
    width_px = grey.shape[1]
    sight = near_w - camera.position_w
    aside_w = aside_of(axis_w, sight)
    depth_m = float(sight @ camera.rotation_wc[:, 2])
    if aside_w is None or depth_m < 1.0:
        return None
    length_m = STRETCH * width_px * depth_m / float(matrix[0, 0])
    half_w = length_m * axis_w
    places_w = np.stack([near_w - half_w, near_w + half_w, near_w + aside_w, near_w])
    pixels, ahead = project_all(places_w, camera, matrix)
    if not ahead.all():
        return None
    start, end, beside, centre = pixels
    px_per_m = math.dist(beside, centre)
    step_px = max(1.0, width_px / ACROSS)
    step_m = step_px / max(px_per_m, 1e-6)
    reach_m = REACH_SIGMAS * sigma_m + WIDEST * chord_m
    steps = int(min(reach_m / step_m, ACROSS))
    across = (beside - centre) / max(px_per_m, 1e-6) * step_px
    strength = _edges(grey, start, end, across, steps)
    usual = float(np.sort(strength)[steps])  # the middle one of 2 steps + 1
    least = max(LEAST_GREY, LEAST_CONTRAST * usual)
    least_m, most_m = _widths(chord_m, thickness_m, width_m)
    widths = (least_m / step_m, most_m / step_m)
    low, high, weaker = _best_pair(strength, steps, widths, sigma_m / step_m, least)
    if weaker <= 0.0:
        return None
    return Strip(
        middle_m=0.5 * (low + high) * step_m,
        width_m=(high - low) * step_m,
        aside_w=aside_w,
        contrast=weaker / max(usual, 1e-6),
    )


def _widths(chord_m: float, thickness_m: float, width_m: float | None) -> tuple[float, float]:
    """Return the least and the most (m) that a blade may show of its width."""
    least_m, most_m = NARROWEST * thickness_m, WIDEST * chord_m
    if width_m is None:
        return least_m, most_m
    about_m = WIDTH_SHARE * width_m + CHORD_SHARE * chord_m
    return max(least_m, width_m - about_m), min(most_m, width_m + about_m)


def aside_of(axis_w: Float, sight_w: Float) -> Float | None:
    """Return the unit vector (3,) across a blade's axis and the sight; None: along the blade."""
    (ax, ay, az), (bx, by, bz) = axis_w.tolist(), sight_w.tolist()
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = math.sqrt(x * x + y * y + z * z)
    return None if size < 1e-6 else np.array([x / size, y / size, z / size])


class StripFollower:
    """Joins what a few frames show, so that one mistaken edge does not move the metering."""

    def __init__(self) -> None:
        self._found: deque[tuple[float, float, float]] = deque(maxlen=_JOINED)

    def reset(self) -> None:
        """Forget: another blade, or another side of it."""
        self._found.clear()

    def update(
        self, strip: Strip | None, stamp_s: float, expected_m: float = 0.0
    ) -> tuple[float, float] | None:
        """Take in a frame; return middle and width (m) as they stand, None: not known.

        ``expected_m``: how far aside of a fixed axis the expected one lies: that moves as the
        LiDAR sees more, the blade does not. The middle returned is from the expected axis.
        """
        while self._found and not 0 <= stamp_s - self._found[0][0] < _FORGOTTEN_S:
            self._found.popleft()
        if strip is not None:
            self._found.append((stamp_s, strip.middle_m + expected_m, strip.width_m))
        if not self._found:
            return None
        middles, widths = zip(*((middle, width) for _, middle, width in self._found), strict=True)
        # Of two the newer: it is the one that the LiDAR's line may have corrected.
        if len(middles) < _JOINED:
            return middles[-1] - expected_m, widths[-1]
        return sorted(middles)[1] - expected_m, sorted(widths)[1]


@njit(cache=True, nogil=True)
def _edges(
    grey: Bytes, start: Float, end: Float, across: Float, steps: int
) -> Float:  # pragma: no cover - compiled
    """Return (2 ``steps`` + 1,) by how much (grey) the picture changes at each step aside."""
    height, width = grey.shape
    count = 2 * steps + 1
    total, seen = np.zeros(count), np.zeros(count)
    profile = np.empty(count)
    for station in range(STATIONS):
        share = station / (STATIONS - 1)
        x0 = start[0] + share * (end[0] - start[0])
        y0 = start[1] + share * (end[1] - start[1])
        for k in range(count):
            x, y = x0 + (k - steps) * across[0], y0 + (k - steps) * across[1]
            i, j = math.floor(y + 0.5), math.floor(x + 0.5)
            inside = 0 <= i < height and 0 <= j < width
            profile[k] = grey[i, j] if inside else -1.0
        for k in range(2, count - 2):
            if profile[k - 2] < 0.0 or profile[k + 2] < 0.0:
                continue
            change = 0.5 * (profile[k + 1] + profile[k + 2] - profile[k - 1] - profile[k - 2])
            total[k] += min(max(change, -MOST_GREY), MOST_GREY)
            seen[k] += 1.0
    for k in range(count):
        total[k] = abs(total[k]) / seen[k] if seen[k] >= STATIONS / 4 else 0.0
    return total


@njit(cache=True, nogil=True)
def _best_pair(
    strength: Float, steps: int, widths: tuple[float, float], sigma: float, least: float
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return the likeliest pair of edges, in steps from the axis, and the weaker one's strength.

    Nothing between them may be stronger than they are; the axis shall run between them.
    """
    best, low, high, weaker = 0.0, 0.0, 0.0, 0.0
    count = len(strength)
    for i in range(2, count - 2):
        if strength[i] < least or strength[i] < strength[i - 1] or strength[i] < strength[i + 1]:
            continue
        between = 0.0
        for j in range(i + 1, min(count - 2, i + int(widths[1]) + 1)):
            # What is next to an edge is that edge.
            if j - i > 4 and j > 4:
                between = max(between, strength[j - 4])
            peak = strength[j] >= strength[j - 1] and strength[j] >= strength[j + 1]
            if strength[j] < least or not peak or j - i < widths[0]:
                continue
            both = min(strength[i], strength[j])
            inner = WITHIN * (j - i)
            beside = max(0.0, i - steps + inner, steps - j + inner)
            if beside > REACH_SIGMAS * sigma:
                continue
            score = both * math.exp(-0.5 * (beside / sigma) ** 2)
            score *= math.exp(-max(0.0, between / both - 1.0))
            if score > best:
                best, low, high, weaker = score, float(i - steps), float(j - steps), both
    return low, high, weaker
