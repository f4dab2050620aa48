"""Where turbines stand in a cloud of which nothing is known: upright things, then the survey.

The ascent knows within some metres where its tower stands (`hub_prior`); a recorded cloud may
show hills, trees and a second turbine. Cells of the ground plan hit at many heights propose a
place each, and the survey of the ascent says which of them is a tower with a rotor before it.
"""

from __future__ import annotations

import numpy as np

from config.turbine import Turbine
from perception.hub_prior import SurveyResult, TowerSurvey
from perception.tower import fit_tower
from perception.values import Float

CELL_M = 2.0
RING_M = 2.0
#: A tower that is worth the name is seen over this many rings of 2 m in one cell.
MIN_RINGS = 6
#: Proposals nearer to each other than this are one; a rotor between them would not turn.
APART_M = 12.0
MOST = 6
SEARCH_M = 6.0


def surveyed_turbines(
    points_w: Float, turbine: Turbine | None, viewpoint_w: Float
) -> list[SurveyResult]:
    """Return towers with what hangs at them, the nearest to the viewpoint first.

    ``points_w``: (N, 3) world metres, z up; ``viewpoint_w``: (3,). Where a rotor's side is seen,
    `SurveyResult.normal_w` names it; towers without come after those with one.
    """
    found: list[SurveyResult] = []
    for place_xy in upright_places(points_w):
        result = _survey(points_w, place_xy, turbine)
        if result is None:
            continue
        feet = [np.linalg.norm((one.tower.foot_w - result.tower.foot_w)[:2]) for one in found]
        if not feet or min(feet) > 0.5 * APART_M:
            found.append(result)

    def rank(result: SurveyResult) -> tuple[bool, float]:
        away = float(np.linalg.norm((result.tower.foot_w - viewpoint_w)[:2]))
        return result.normal_w is None, away

    return sorted(found, key=rank)


def upright_places(points_w: Float) -> list[Float]:
    """Return up to six places (2,) of the ground plan that are hit at many heights, best first."""
    low = points_w.min(axis=0)
    steps = np.floor((points_w - low) / (CELL_M, CELL_M, RING_M)).astype(np.int64)
    _, deep, high = (steps.max(axis=0) + 1).tolist()
    # One number a cell and ring: a table's rows take twenty times as long to sort.
    rings = np.unique((steps[:, 0] * deep + steps[:, 1]) * high + steps[:, 2])
    keys, heights = np.unique(rings // high, return_counts=True)
    cells = np.stack([keys // deep, keys % deep], axis=1)
    places: list[Float] = []
    for k in np.argsort(-heights, kind="stable"):
        if heights[k] < MIN_RINGS or len(places) == MOST:
            break
        place = low[:2] + (cells[k] + 0.5) * CELL_M
        if all(np.linalg.norm(place - other) > APART_M for other in places):
            places.append(np.asarray(place, np.float64))
    return places


def _survey(points_w: Float, place_xy: Float, turbine: Turbine | None) -> SurveyResult | None:
    around = np.linalg.norm(points_w[:, :2] - place_xy, axis=1) < 2 * SEARCH_M
    ground_m = float(np.quantile(points_w[around, 2], 0.01))
    if turbine is not None:
        # The ground may not be in the picture: the tower's top tells better where it is.
        tower = fit_tower(
            points_w[around], expected_xy=place_xy, turbine=turbine, search_m=SEARCH_M
        )
        if tower is not None and tower.top_m is not None:
            ground_m = tower.top_m - turbine.tower_height_m
    expected_w = np.array([place_xy[0], place_xy[1], ground_m])
    survey = TowerSurvey(expected_w=expected_w, turbine=turbine, search_m=SEARCH_M)
    survey.update(points_w, 0.0)
    return survey.result()
