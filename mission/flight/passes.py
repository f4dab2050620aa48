"""Which stretch of a blade's side is seen from where: views, distances, and what stays unseen.

A pass looks at one side of one blade. Seen straight on, its line may come too near the tower, the
nacelle or a neighbouring blade, or ask the gimbal to look where it cannot. So the view is also
tried turned about the blade's axis, and farther away; the view with the best coverage is flown,
and oblique ones beside it where they add enough: metres that it leaves unseen, or skin that it
meets too flat. What remains is listed by metre with its reason.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from config.settings import Settings
from config.turbine import Turbine
from mission.flight.footprint import footprint_m, half_across_m, photo_metres
from mission.flight.leg import Leg, SidePass, Unseen
from mission.flight.rotor_model import RotorModel
from mission.flight.section import Section
from mission.flight.sides import BladeFrame, side_view
from mission.flight.skin import blade_skin
from mission.flight.views import Around, Mask, View, judged_views, runs_of, sight
from perception.values import Float

MIN_STRETCH_M = 2.0
#: A second view of a side is flown for at least this share of the blade.
MIN_GAIN = 0.05
#: Where the gimbal cannot look along the straight view, the blade is also tried from a place
#: farther up or down its axis: the view leans along the axis by these angles.
SLANTS_DEG = (-30, -20, 20, 30)
#: Oblique views beside the chosen one: at most so many, turned so far, each for at least this share
#: of the side's skin, and none where so much is shown. What is met flatter is not counted.
MOST_OBLIQUE, OBLIQUE_DEG = 2, (0, 15, -15, 30, -30, 45, -45, 52, -52, 57, -57)
MIN_SKIN_GAIN, ENOUGH_SKIN, FLATTEST_DEG = 0.07, 0.95, 58.5
#: An oblique view is flown along where it adds this share of the skin there.
MIN_GAIN_THERE = 0.15
#: Left beside the blade where it is photographed in rows.
ROW_MARGIN_M = 0.25
#: The speed at which closer photos along a blade begin to slow the flight.
PACE_MPS = 1.9
#: A row of fewer photos is not worth its flight.
LEAST_ROW = 3
#: A strip as wide as this at the chord's ends is no reason to fly along the blade once more.
ROW_SPARED_M = 0.15
UPRIGHT: Float = np.array([0.0, 0.0, 1.0])


def plan_side(
    frame: BladeFrame,
    side: str,
    model: RotorModel,
    turbine: Turbine,
    settings: Settings,
    ground_m: float,
    lean_w: Float = UPRIGHT,
) -> SidePass:
    """Plan the legs for a side of a blade.

    ``ground_m`` is the height (z) of the ground. ``lean_w``: (3,) where the airframe's up axis
    points while it hovers in this wind: the LiDAR's field of view leans with it.
    """
    length = frame.length_m
    if frame.pitch_rad is None:
        reason = "the blade's pitch is not known, so neither are its sides"
        return SidePass(frame.name, side, (), (Unseen(0.0, length, reason),), 0.0, length)
    grid: Float = np.linspace(0.0, length, math.ceil(length) + 1, dtype=np.float64)
    straight = side_view(frame, side, turbine)
    turns = [t for t in (0, 15, -15, 30, -30, 45, -45, 60, -60)
             if abs(t) <= settings.tracking.max_view_turn_deg]  # fmt: skip
    section = Section(frame, turbine, grid)
    around = Around(model, settings, ground_m, lean_w)
    views = judged_views(frame, straight, turns, (0,), section, around)
    if not any(sight(view.view_w, around) for view in views):
        views += judged_views(frame, straight, turns, SLANTS_DEG, section, around)
    best = max(views, key=lambda v: v.worth * int(v.seen.sum()) * _nearness(v))
    chosen = [(best, best.seen)]
    second = _second(frame, straight, turns, section, around, best)
    if second is not None:
        chosen.append((second, second.seen))
    chosen += _oblique(frame, side, straight, section, around, [view for view, _ in chosen])
    legs = tuple(
        leg
        for view, mask in chosen
        for a, b in runs_of(mask)
        if grid[b] - grid[a] >= MIN_STRETCH_M
        for leg in _legs(frame, side, view, grid, slice(a, b + 1), turbine, settings)
    )
    seen = np.zeros(len(grid), bool)
    for leg in legs:
        seen |= (grid >= leg.grid_m[0] - 1e-6) & (grid <= leg.grid_m[-1] + 1e-6)
    unseen = tuple(_unseen(~seen, grid, best))
    planned = length - sum(u.to_m - u.from_m for u in unseen)
    return SidePass(frame.name, side, legs, unseen, planned, length)


def _second(
    frame: BladeFrame,
    straight_w: Float,
    turns: Sequence[int],
    section: Section,
    around: Around,
    best: View,
) -> View | None:
    """Return the view that shows most of the longest stretch that the best one leaves unseen.

    Near the root it mostly leans along the blade: from farther out one sees in under the nacelle.
    """
    grid = section.grid_m
    runs = runs_of(~best.seen)
    if not runs:
        return None
    a, b = max(runs, key=lambda run: run[1] - run[0])
    if b - a + 1 < max(MIN_STRETCH_M, MIN_GAIN * len(grid)):
        return None
    views = judged_views(frame, straight_w, turns, (0, *SLANTS_DEG), section.part(a, b + 1), around)
    view = max(views, key=lambda v: v.worth * int(v.seen.sum()))
    if view.seen.sum() < max(MIN_STRETCH_M, MIN_GAIN * len(grid)):
        return None
    distance = np.full(len(grid), np.nan)
    distance[a : b + 1] = view.distance_m
    return replace(view, distance_m=distance, reason=best.reason)


def _oblique(
    frame: BladeFrame,
    side: str,
    straight_w: Float,
    section: Section,
    around: Around,
    chosen: list[View],
) -> list[tuple[View, Mask]]:
    """Return views, and where to fly them, for skin that the chosen ones do not show."""
    skin, grid = blade_skin(frame, section.turbine)[side], section.grid_m
    place = np.clip(np.rint(skin.metres / (grid[1] - grid[0])), 0, len(grid) - 1).astype(np.intp)
    whole = float(skin.areas_m2.sum())

    def shows(view: View) -> Mask:
        met = skin.normals_w @ view.view_w >= math.cos(math.radians(FLATTEST_DEG))
        shown: Mask = met & view.seen[place]
        return shown

    shown = np.zeros(len(place), bool)
    for view in chosen:
        shown |= shows(view)
    found: list[tuple[View, Mask]] = []
    for slants in ((0,), SLANTS_DEG):
        if float(skin.areas_m2[shown].sum()) >= ENOUGH_SKIN * whole:
            break
        views = judged_views(frame, straight_w, OBLIQUE_DEG, slants, section, around)
        while views and len(found) < MOST_OBLIQUE:
            gains = [float(skin.areas_m2[shows(view) & ~shown].sum()) for view in views]
            best = int(
                np.argmax([gain * view.worth for gain, view in zip(gains, views, strict=True)])
            )
            if gains[best] < MIN_SKIN_GAIN * whole:
                break
            stretch = _where(grid, place, skin.areas_m2, shows(views[best]) & ~shown)
            found.append((views[best], views[best].seen & stretch))
            shown |= shows(views[best])
    return found


def _where(grid: Float, place: NDArray[np.intp], areas_m2: Float, more: Mask) -> Mask:
    """Return which metres (M,) lie between the first and the last where a view adds enough."""
    there = np.bincount(place, areas_m2, len(grid))
    added = np.bincount(place[more], areas_m2[more], len(grid))
    least = min(MIN_GAIN_THERE, 0.5 * float(added.sum() / there.sum()))
    worth = np.flatnonzero(added > least * np.maximum(there, 1e-9))
    stretch: Mask = np.zeros(len(grid), bool)
    stretch[worth.min() : worth.max() + 1] = True
    return stretch


def _nearness(view: View) -> float:
    """Return what the view's distance is worth: 1 at the wanted one, less from farther away."""
    seen = view.seen
    return float((12.0 / view.distance_m[seen]).mean()) if seen.any() else 0.0


def _legs(
    frame: BladeFrame,
    side: str,
    view: View,
    grid: Float,
    stretch: slice,
    turbine: Turbine,
    settings: Settings,
) -> list[Leg]:
    """Return the leg of a stretch, and one more where the blade is wider than the picture."""
    grid, distance = grid[stretch], view.distance_m[stretch]
    section = Section(frame, turbine, grid)
    footprint = footprint_m(frame.axis_w, view.view_w, float(distance.min()), settings)
    overlap = settings.tracking.overlap
    across, half_width = section.across(view.view_w), section.half_width(view.view_w)
    # Photos that lie closer show more of the chord: up to the camera's own pace they cost no time,
    # while a second row is a second flight along the blade.
    wide = footprint * (1 - overlap)
    close = min(wide, PACE_MPS * settings.camera.min_interval_s)
    for spacing in (wide, close):
        room = np.array(
            [
                half_across_m(frame.axis_w, view.view_w, float(d), spacing, settings)
                for d in distance
            ]
        )
        rows = half_width - room > ROW_SPARED_M
        if not rows.any():
            break
    overlap = 1 - spacing / footprint
    photos = photo_metres(float(grid[0]), float(grid[-1]), footprint, overlap)
    over = np.maximum(half_width - room + ROW_MARGIN_M, 0.0) * float(rows.any())
    one = Leg(
        frame.name, side, frame.root_w, frame.axis_w, view.view_w, float(view.turn_deg),
        grid, distance, footprint, photos, frame.length_m,
        section.centre(view.view_w), over[:, None] * across, view.blind,
        apparent_w=section.apparent(view.view_w, distance),
    )  # fmt: skip
    if not rows.any():
        return [one]
    first, last = float(grid[rows][0]), float(grid[rows][-1])
    other = photo_metres(max(first, float(grid[0])), max(last, first + 0.1), footprint, overlap)
    if len(other) < LEAST_ROW:
        return [replace(one, aside_w=np.zeros_like(one.aside_w))]
    return [one, replace(one, photos=other, aside_w=-one.aside_w)]


def _unseen(missing: Mask, grid: Float, view: View) -> list[Unseen]:
    """Merge neighbouring metres of one reason; half a metre to each side belongs to the gap."""
    gaps: list[Unseen] = []
    step = float(grid[1] - grid[0])
    for a, b in runs_of(missing):
        start = a
        for metre in range(a, b + 1):
            if metre == b or view.reason[metre + 1] != view.reason[start]:
                reason = view.reason[start]
                if view.seen[start]:
                    reason = "a stretch too short to be flown"
                gaps.append(
                    Unseen(
                        max(0.0, float(grid[start]) - step / 2),
                        min(float(grid[-1]), float(grid[metre]) + step / 2),
                        reason,
                    )
                )
                start = metre + 1
    return gaps
