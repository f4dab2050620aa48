"""Which views of a side are flown: few that together show its skin, and show it finely.

Greedy set cover over the facets of the side's skin (`mission.flight.skin`). The first view is the
one that shows most, straight ones preferred; each further one adds the most for the length that it
is flown along, until none adds enough. What the tower hides is not seen. Skin that a photo shows
too coarsely counts for less than skin that it shows finely, so that a root seen from afar is looked
at again from nearer where some view allows it; but more is given for skin that nothing shows yet.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from config.settings import Settings
from mission.flight.footprint import gsd_m
from mission.flight.occlusion import behind_tower
from mission.flight.section import Section
from mission.flight.sides import BladeFrame, side_view
from mission.flight.skin import Skin, blade_skin
from mission.flight.views import Around, Mask, View, judged_views
from perception.values import Float

#: Views are turned about the blade's axis and lean along it by these angles. The first one is
#: turned by at most `tracking.max_view_turn_deg`; the others look at what it does not show.
TURNS_DEG = (0, 15, -15, 30, -30, 45, -45, 60, -60, 75, -75)
SLANTS_DEG = ((15, -15), (30, -30), (45, -45))
#: Leaning views are only judged where the upright ones together are worth less than this.
ENOUGH = 0.97
MOST_VIEWS = 4
#: A further view must add so much of the side's skin, in all; and is flown along where it adds
#: this share of the skin there.
MIN_GAIN, MIN_GAIN_THERE = 0.045, 0.15
#: Skin that no view shows so far is worth so many times skin that is shown more finely.
HIDDEN_WORTH = 3.0
#: Met flatter than this, skin is not counted on: the limit is 60 deg, and aim and pose err.
FLATTEST_DEG = 57.5
#: The pixel that shows damage well; what skin shown more coarsely is worth less; and what the
#: distance may come out longer in flight.
FINE_GSD_MM, COARSE_LOSS, WANDER_M = 1.0, 0.4, 0.15
#: Between two photos skin lies off the axis, and farther away than it is deep.
OFF_AXIS = 0.99
#: Stands for the distance of a metre that cannot be flown.
FAR_M = 1e4
#: What the first view, flown along the whole blade, is worth by how far it leans along the axis:
#: upright ones hold their distance better, and are the perpendicular ones.
LEAN_WORTH = {0: 1.0, 15: 0.85, 30: 0.75, 45: 0.65}
#: Flying to a view costs as much as flying along this share of the blade.
WAY_SHARE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Chosen:
    """A view, and along which metres (M,) it is flown."""

    view: View
    stretch: Mask


def cover_steps(
    frame: BladeFrame, side: str, section: Section, around: Around
) -> Iterator[tuple[Chosen, ...] | None]:
    """Choose the views of a side: yields None after each slice of the work and, last, the views.

    The first of them is there even where no metre of it can be flown: it tells why.
    """
    straight_w = side_view(frame, side, section.turbine)
    skin = blade_skin(frame, section.turbine)[side]
    cover = _Cover(skin, frame, section, around)
    cover.add(judged_views(frame, straight_w, TURNS_DEG, (0,), section, around))
    chosen, worth = cover.choose()
    yield None
    if worth < ENOUGH:
        for slants in SLANTS_DEG:
            cover.add(judged_views(frame, straight_w, TURNS_DEG, slants, section, around))
            yield None
        chosen, _ = cover.choose()
    yield chosen


def _far_m(gsd_mm: float, settings: Settings) -> float:
    """Return up to which distance a picture is as fine as that."""
    return gsd_mm / 1000.0 / gsd_m(1.0, settings) - WANDER_M


@dataclass(slots=True)
class _Cover:
    """The skin of a side, and what each view is worth to it."""

    skin: Skin
    frame: BladeFrame
    section: Section
    around: Around
    views: list[View] = field(default_factory=list)
    worths: list[Float] = field(default_factory=list)
    """(N,) each: of every facet 1 where it is shown finely, less where coarsely, or 0."""
    _place: NDArray[np.intp] = field(init=False)
    _shares: Float = field(init=False)
    _feet_w: Float = field(init=False)
    _reach_m: float = field(init=False)
    _fine_m: float = field(init=False)

    def __post_init__(self) -> None:
        grid, skin = self.section.grid_m, self.skin
        near = np.rint(skin.metres / (grid[1] - grid[0])).astype(np.intp)
        self._place = np.clip(near, 0, len(grid) - 1)
        # A trailing edge so sharp that no skin faces its view is flown straight.
        self._shares = skin.areas_m2 / max(float(skin.areas_m2.sum()), 1e-9)
        self._feet_w = self.frame.root_w + skin.metres[:, None] * self.frame.axis_w
        most_mm = self.around.settings.tracking.max_gsd_mm
        self._fine_m = _far_m(min(FINE_GSD_MM, most_mm), self.around.settings)
        self._reach_m = OFF_AXIS * _far_m(most_mm, self.around.settings)

    def add(self, views: list[View]) -> None:
        """Weigh more views."""
        for view in views:
            self.views.append(view)
            self.worths.append(self._worth(view))

    def _worth(self, view: View) -> Float:
        met = self.skin.normals_w @ view.view_w >= math.cos(math.radians(FLATTEST_DEG))
        met &= view.seen[self._place]
        distance = np.nan_to_num(view.distance_m, nan=FAR_M)
        aimed = self.section.centre(view.view_w) + distance[:, None] * view.view_w
        eyes_w = self._feet_w + aimed[self._place]
        depth = (eyes_w - self.skin.points_w) @ view.view_w
        met &= depth <= self._reach_m
        met &= ~behind_tower(eyes_w, self.skin.points_w, self.around.model)
        fine = np.where(depth <= self._fine_m, 1.0, 1.0 - COARSE_LOSS)
        return np.asarray(met * fine, np.float64)

    def choose(self) -> tuple[tuple[Chosen, ...], float]:
        """Return the views to be flown, and what they are worth together: at most 1."""
        first = self._first()
        chosen = [Chosen(self.views[first], self.views[first].seen)]
        shown = self.worths[first]
        while len(chosen) < MOST_VIEWS:
            added = [np.maximum(worth - shown, 0.0) for worth in self.worths]
            hidden = shown <= 0.0
            scores = [
                self._score(view, more, hidden)
                for view, more in zip(self.views, added, strict=True)
            ]
            best = int(np.argmax(scores))
            if scores[best] <= 0.0:
                break
            stretch = self.views[best].seen & self._where(added[best])
            chosen.append(Chosen(self.views[best], stretch))
            # Only what is flown is shown.
            shown = np.maximum(shown, self.worths[best] * stretch[self._place])
        return tuple(chosen), float(self._shares @ shown)

    def _first(self) -> int:
        """Return the view that shows most, those turned far only where no other shows anything."""
        most_deg = self.around.settings.tracking.max_view_turn_deg
        values = [
            float(self._shares @ worth) * view.worth * LEAN_WORTH[abs(view.slant_deg)]
            for view, worth in zip(self.views, self.worths, strict=True)
        ]
        turned = [
            value if abs(view.turn_deg) <= most_deg else 0.0
            for value, view in zip(values, self.views, strict=True)
        ]
        return int(np.argmax(turned if max(turned) > 0.0 else values))

    def _score(self, view: View, added: Float, hidden: NDArray[np.bool_]) -> float:
        """Return what a further view adds for the length that it is flown along; 0: too little.

        Skin that is ``hidden`` so far counts more than skin that is shown more finely.
        """
        gain = float(self._shares @ (added * np.where(hidden, HIDDEN_WORTH, 1.0)))
        if gain < MIN_GAIN:
            return 0.0
        stretch = float(self._where(added).mean())
        return gain * math.sqrt(view.worth) / (WAY_SHARE + stretch)

    def _where(self, added: Float) -> Mask:
        """Return which metres (M,) lie between the first and the last where enough is added."""
        count = len(self.section.grid_m)
        there = np.bincount(self._place, self._shares, count)
        more = np.bincount(self._place, self._shares * added, count)
        least = min(MIN_GAIN_THERE, 0.5 * float(more.sum() / there.sum()))
        worth = np.flatnonzero(more > least * np.maximum(there, 1e-9))
        stretch: Mask = np.zeros(count, bool)
        if len(worth):
            stretch[worth.min() : worth.max() + 1] = True
        return stretch
