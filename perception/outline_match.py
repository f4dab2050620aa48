"""Lay a blade's modelled outline on its edges in the picture.

What the LiDAR knows of a blade's place across its axis is a decimetre or two where it sees few
points, or half a chord where it sees one edge. The picture knows it to a centimetre: both edges,
a known width apart, are looked for beside where they are drawn. Only the place across the axis and
the small angle to it are changed: along the axis a blade looks much the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from perception.blade_in_picture import BladeStations, edges_px
from perception.lens import Lens
from perception.values import Bytes, CameraPose, Float

#: The search: this far aside, in such steps, at so many leans to each side.
REACH_M, STEP_M = 1.5, 0.02
LEANS = np.linspace(-0.06, 0.06, 13)
#: An outline farther from where the LiDAR saw it is less likely.
PRIOR_M, PRIOR_LEAN = 0.8, 0.03
#: The picture is made this wide: finer is noise and texture.
WIDTH_PX = 648
BLUR_PX = 1.5
SAMPLES = 60
#: Fewer points of an edge inside the picture do not tell where it is.
LEAST = 12
#: The best place must be this much better than the middle one, or nothing is believed.
LEAST_CONTRAST = 1.8
MATCHED_SIGMA_M = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """Where the outline lies."""

    stations: BladeStations
    shift_m: float
    lean: float
    contrast: float
    """Strength of the edges there, over what is usual in this picture."""


def match_outline(
    grey: Bytes, stations: BladeStations, camera: CameraPose, lens: Lens
) -> Match | None:
    """Return the blade moved onto its edges in a picture (H, W), None where they are not found."""
    one, other = edges_px(stations, camera, lens)
    if len(one) != len(stations.metre_m):
        return None
    aside_w, normal, metres = _directions(stations, camera, one, other)
    depth = (stations.centre_w - camera.position_w) @ camera.rotation_wc[:, 2]
    px_per_m = lens.focal_px / depth
    scale = WIDTH_PX / lens.width_px
    gradient = _gradient(grey, scale)
    near = _in_sight((one + other) / 2, lens)
    shifts = np.arange(-REACH_M, REACH_M + STEP_M / 2, STEP_M)
    middle = float(metres.mean())
    strength = np.empty((len(LEANS), len(shifts)))
    for row, lean in enumerate(LEANS):
        moved_m = shifts[:, None] + lean * (metres - middle)
        offsets = (moved_m * px_per_m)[:, :, None] * normal
        sides = [
            _strength(gradient, (edge + offsets) * scale, normal, near) for edge in (one, other)
        ]
        strength[row] = np.sqrt(sides[0] * sides[1])
    prior = np.exp(-0.5 * ((shifts / PRIOR_M) ** 2 + (LEANS[:, None] / PRIOR_LEAN) ** 2))
    score = strength * prior
    row, column = divmod(int(score.argmax()), len(shifts))
    there = strength[row][strength[row] > 0]
    contrast = float(strength[row, column] / np.median(there)) if len(there) else 0.0
    if contrast < LEAST_CONTRAST:
        return None
    shift, lean = float(shifts[column]), float(LEANS[row])
    moved = stations.moved((shift + lean * (stations.metre_m - middle))[:, None] * aside_w)
    return Match(moved, shift, lean, contrast)


def _directions(
    stations: BladeStations, camera: CameraPose, one: Float, other: Float
) -> tuple[Float, Float, Float]:
    """Return the direction aside (3,), its direction in the picture (S, 2), and metres (S,)."""
    axis = stations.centre_w[-1] - stations.centre_w[0]
    axis = axis / np.linalg.norm(axis)
    view = stations.centre_w.mean(axis=0) - camera.position_w
    aside = np.cross(axis, view)
    aside = aside / np.linalg.norm(aside)
    in_picture = (aside @ camera.rotation_wc)[:2]
    along = np.gradient((one + other) / 2, axis=0)
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    return aside, normal * np.sign(normal @ in_picture)[:, None], stations.metre_m


def _gradient(grey: Bytes, scale: float) -> Float:
    """Return (H', W', 2) gradients of the picture made smaller and smooth."""
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(small.astype(np.float32), (0, 0), BLUR_PX)
    return np.dstack(
        [cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)]
    ).astype(np.float64)


def _in_sight(middle_px: Float, lens: Lens) -> tuple[int, int]:
    """Return the first and last section (K, 2) that may show in the picture, moved aside or not."""
    size = np.array([lens.width_px, lens.height_px])
    inside = (np.abs(middle_px - size / 2) < size).all(axis=1)
    rows = np.flatnonzero(inside)
    if len(rows) == 0:
        return 0, len(middle_px) - 1
    return max(int(rows[0]) - 1, 0), min(int(rows[-1]) + 1, len(middle_px) - 1)


def _strength(gradient: Float, edges_px: Float, normal: Float, near: tuple[int, int]) -> Float:
    """Return (C,) the mean strength of the edge along C candidates (C, S, 2); 0 out of sight.

    ``near``: the first and last of the S points to be looked at.
    """
    height, width = gradient.shape[:2]
    at = np.linspace(*near, SAMPLES)
    low = np.minimum(at.astype(int), edges_px.shape[1] - 2)
    share = (at - low)[None, :, None]
    points = edges_px[:, low] * (1 - share) + edges_px[:, low + 1] * share
    across = normal[low]
    columns, rows = np.round(points[:, :, 0]).astype(int), np.round(points[:, :, 1]).astype(int)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    found = gradient[np.where(inside, rows, 0), np.where(inside, columns, 0)]
    # A root of the strength: a short strong edge must not outweigh a long weak one.
    strength = np.sqrt(np.abs(np.einsum("csk,sk->cs", found, across))) * inside
    count = inside.sum(axis=1)
    return np.asarray(
        np.where(count >= LEAST, strength.sum(axis=1) / np.maximum(count, 1), 0.0), np.float64
    )
