"""Where a blade ends in the picture: the one place at which a picture tells metres by itself.

Along the blade the outline ends and an edge runs across it. Both are looked for on the modelled
outline, lengthened beyond its tip, once that outline lies on the blade (`outline_match`).
"""

from __future__ import annotations

import cv2
import numpy as np

from perception.blade_in_picture import BladeStations, Bools, edges_px
from perception.lens import Lens
from perception.values import Bytes, CameraPose, Float

STEP_M = 0.02
TIP_SIGMA_M = 0.1
#: The picture is made this wide, and so smooth.
WIDTH_PX, BLUR_PX = 1296, 2.0
#: The outline is taken as straight over this much before the tip.
STRAIGHT_M = 2.0
#: Over so much before and after the end the two edges must be there, and must not.
BESIDE_M = 0.6
#: Edges before the end are so much stronger than after it; the end itself than what is usual.
LEAST_STEP, LEAST_CONTRAST = 2.0, 4.0
#: So much of the width, in its middle, is looked at across the end.
MIDDLE = 0.5
_ACROSS = 9


def find_tip(
    grey: Bytes,
    stations: BladeStations,
    camera: CameraPose,
    lens: Lens,
    length_m: float,
    reach_m: float,
) -> float | None:
    """Return at which metre of the drawn blade its end is seen, None where it is not.

    ``grey``: (H, W); ``stations``: drawn in the picture, up to the tip at ``length_m``;
    ``reach_m``: how far from there it may be.
    """
    one, other = edges_px(stations, camera, lens)
    metres = stations.metre_m
    last = metres > length_m - STRAIGHT_M - 1e-6
    if len(one) != len(metres) or metres[-1] < length_m - 1e-3 or last.sum() < 3:
        return None
    low, high = length_m - reach_m - BESIDE_M, length_m + reach_m + BESIDE_M
    grid: Float = np.arange(low, high, STEP_M, dtype=np.float64)
    scale = WIDTH_PX / lens.width_px
    sides = [_lengthened(metres[last], edge[last] * scale, grid) for edge in (one, other)]
    along = (sides[0] + sides[1])[-1] - (sides[0] + sides[1])[0]
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    gradient = _gradient(grey, scale)
    share = np.linspace(0.5 - MIDDLE / 2, 0.5 + MIDDLE / 2, _ACROSS)[:, None, None]
    across = sides[0] * (1 - share) + sides[1] * share
    end, seen = _profile(gradient, across, along)
    normal = np.array([-along[1], along[0]])
    edge, edge_seen = _profile(gradient, np.stack(sides), normal)
    return _end(grid, end, edge, seen & edge_seen, length_m, reach_m)


def _end(
    grid: Float, end: Float, edge: Float, seen: Bools, length_m: float, reach_m: float
) -> float | None:
    """Return the metre at which the edges stop and an edge lies across."""
    count = round(BESIDE_M / STEP_M)
    total = np.concatenate([[0.0], np.cumsum(edge)])
    at = np.arange(count, len(grid) - count)
    before = (total[at] - total[at - count]) / count
    after = (total[at + count] - total[at]) / count
    whole = np.concatenate([[0.0], np.cumsum(seen)])
    visible = whole[at + count] - whole[at - count] == 2 * count
    allowed = visible & (np.abs(grid[at] - length_m) <= reach_m)
    allowed &= before > LEAST_STEP * after
    if not allowed.any():
        return None
    score = np.where(allowed, end[at] * (before - after), 0.0)
    best = int(score.argmax())
    usual = float(np.median(end[at][visible]))
    if end[at][best] < LEAST_CONTRAST * usual:
        return None
    return float(grid[at][best])


def _lengthened(metres: Float, edge: Float, grid: Float) -> Float:
    """Return (G, 2) pixels of an edge (K, 2), straight on beyond its last sections."""
    columns = [np.polyval(np.polyfit(metres, edge[:, k], 1), grid) for k in (0, 1)]
    return np.asarray(np.stack(columns, axis=1), np.float64)


def _profile(gradient: Float, points: Float, direction: Float) -> tuple[Float, Bools]:
    """Return (G,) the gradient along a direction, mean over lines (L, G, 2), and what is inside."""
    height, width = gradient.shape[:2]
    columns, rows = np.round(points[..., 0]).astype(int), np.round(points[..., 1]).astype(int)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    found = gradient[np.where(inside, rows, 0), np.where(inside, columns, 0)] @ direction
    # Across the end all points agree in sign; the two edges of a blade do not.
    mean = np.abs(found.mean(axis=0)) if len(points) > 2 else np.abs(found).mean(axis=0)
    return np.asarray(mean, np.float64), np.asarray(inside.all(axis=0), np.bool_)


def _gradient(grey: Bytes, scale: float) -> Float:
    small = grey if scale == 1.0 else cv2.resize(
        grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA
    )  # fmt: skip
    smooth = cv2.GaussianBlur(small.astype(np.float32), (0, 0), BLUR_PX)
    both = [cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)]
    return np.dstack(both).astype(np.float64)
