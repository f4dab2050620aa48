"""The legs along a blade's side: where they lie, where photos are taken, and what stays unseen.

A pass looks at one side of one blade, from the views that `mission.flight.view_cover` chose. Each
stretch of a view that can be flown is a leg, or two where the blade is wider than the picture.
What remains is listed by metre with its reason.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from config.settings import Settings
from config.turbine import Turbine
from mission.flight.footprint import footprint_m, half_across_m, photo_metres
from mission.flight.leg import Leg, SidePass, Unseen
from mission.flight.rotor_model import RotorModel
from mission.flight.section import Section
from mission.flight.sides import BladeFrame
from mission.flight.view_cover import Chosen, cover_steps
from mission.flight.views import Around, Mask, View, runs_of
from perception.values import Float

MIN_STRETCH_M = 2.0
#: Left beside the blade where it is photographed in rows.
ROW_MARGIN_M = 0.25
#: The speed at which closer photos along a blade begin to slow the flight.
PACE_MPS = 1.9
#: A row of fewer photos is not worth its flight.
LEAST_ROW = 3
#: A strip as wide as this at the chord's ends is no reason to fly along the blade once more.
ROW_SPARED_M = 0.15
UPRIGHT: Float = np.array([0.0, 0.0, 1.0])


def side_steps(
    frame: BladeFrame,
    side: str,
    model: RotorModel,
    turbine: Turbine,
    settings: Settings,
    ground_m: float,
    lean_w: Float = UPRIGHT,
) -> Iterator[SidePass | None]:
    """Plan the legs for a side of a blade: yields None after each slice and, last, the pass.

    ``ground_m`` is the height (z) of the ground. ``lean_w``: (3,) where the airframe's up axis
    points while it hovers in this wind: the LiDAR's field of view leans with it.
    """
    length = frame.length_m
    if frame.pitch_rad is None:
        reason = "the blade's pitch is not known, so neither are its sides"
        yield SidePass(frame.name, side, (), (Unseen(0.0, length, reason),), 0.0, length)
        return
    grid: Float = np.linspace(0.0, length, math.ceil(length) + 1, dtype=np.float64)
    section = Section(frame, turbine, grid)
    chosen: tuple[Chosen, ...] = ()
    for step in cover_steps(frame, side, section, Around(model, settings, ground_m, lean_w)):
        if step is None:
            yield None
        else:
            chosen = step
    legs = tuple(
        leg
        for one in chosen
        for a, b in runs_of(one.stretch)
        if grid[b] - grid[a] >= MIN_STRETCH_M
        for leg in _legs(frame, side, one.view, grid, slice(a, b + 1), turbine, settings)
    )
    seen = np.zeros(len(grid), bool)
    for leg in legs:
        seen |= (grid >= leg.grid_m[0] - 1e-6) & (grid <= leg.grid_m[-1] + 1e-6)
    unseen = tuple(_unseen(~seen, grid, chosen[0].view))
    planned = length - sum(u.to_m - u.from_m for u in unseen)
    yield SidePass(frame.name, side, legs, unseen, planned, length)


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
