"""Which stretch of a blade's side is seen from where: views, distances, and what stays unseen.

A pass looks at one side of one blade. Seen straight on, its line may come too near the tower, the
nacelle or a neighbouring blade, or ask the gimbal to look where it cannot. So the view is also
tried turned about the blade's axis, and farther away; the view with the best coverage is flown,
and a second, oblique one where that adds enough. What remains is listed by metre with its reason.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from config.settings import Settings
from config.turbine import Turbine
from mission.flight.footprint import footprint_m, half_across_m, photo_metres
from mission.flight.rotor_model import RotorModel
from mission.flight.sides import BladeFrame, side_view, turned
from perception.values import Float

Mask = NDArray[np.bool_]

#: Kept beside the guard's clearance for wander, lag and the vehicle's position error.
TRACKING_MARGIN_M = 1.0
#: To tower and neighbour blades, which a whole pass may lie beside: near the clearance the guard
#: lets nothing move but slowly. (Nacelle and hub are only met at a pass's end.)
OTHERS_MARGIN_M = 1.8
GROUND_MARGIN_M = 12.0
#: The distance changes by at most this per metre of blade: a gentle line to fly.
MAX_SLOPE = 0.6
MIN_STRETCH_M = 2.0
#: A second view of a side is flown for at least this share of the blade.
MIN_GAIN = 0.05
#: Where the gimbal cannot look along the straight view, the blade is also tried from a place
#: farther up or down its axis: the view leans along the axis by these angles.
SLANTS_DEG = (-30, -20, 20, 30)
#: Left beside the blade where it is photographed in rows.
ROW_MARGIN_M = 0.25
#: The speed at which closer photos along a blade begin to slow the flight.
PACE_MPS = 1.9
#: A row of fewer photos is not worth its flight.
LEAST_ROW = 3
#: A strip as wide as this at the chord's ends is no reason to fly along the blade once more.
ROW_SPARED_M = 0.15
#: How far gusts rock the airframe, and the LiDAR with it.
WOBBLE_DEG = 3.0
UPRIGHT: Float = np.array([0.0, 0.0, 1.0])
#: Steeper below the horizon than this the gimbal would have to turn over when the vehicle wanders.
STEEPEST_DEG = -76.0
#: Where the LiDAR does not see the blade, the vehicle flies on the fitted rotor: farther away, and
#: clearer of everything by so much.
BLIND_DISTANCE_M = 14.0
BLIND_MARGIN_M = 1.0
BLIND_WORTH = 0.85
#: What a view is worth by its angle off the straight one: skin that faces the side's own view is
#: then seen at a slant.
WORTH_ANGLE_DEG = (0.0, 15.0, 30.0, 45.0, 60.0)
WORTH = (1.0, 0.97, 0.88, 0.75, 0.5)


@dataclass(frozen=True, eq=False)
class Leg:
    """One line along a blade, flown in one go from ``photos[0]`` to ``photos[-1]``."""

    blade: str
    side: str
    root_w: Float
    axis_w: Float
    view_w: Float
    """(3,) unit, from the blade's axis towards the vehicle; leans along the axis where slanted."""
    turn_deg: float
    grid_m: Float
    """(M,) metres, rising."""
    distance_m: Float
    """(M,) distance from the axis at each."""
    footprint_m: float
    photos: tuple[float, ...]
    """Metres, in the order flown."""
    length_m: float
    centre_w: Float
    """(M, 3) from the undeflected axis to the blade's middle as seen from the view: prebend, and
    half the chord's excess on one side of the axis."""
    aside_w: Float
    """(M, 3) from there to what the camera is aimed at; not 0 where the blade is wider than the
    picture and is photographed in rows."""
    blind: bool = False
    """The LiDAR does not see the blade from here: the fitted rotor holds the distance."""
    again: bool = False
    """Flown for gaps of an earlier leg."""

    def distance_at(self, metre: float) -> float:
        """Return the planned distance from the blade's axis."""
        return float(np.interp(metre, self.grid_m, self.distance_m))

    def foot(self, metre: float) -> Float:
        """Return the point (3,) of the blade's axis at a metre."""
        return self.root_w + metre * self.axis_w

    def centre(self, metre: float) -> Float:
        """Return the offset (3,) from the undeflected axis to the blade's middle."""
        return _column(metre, self.grid_m, self.centre_w)

    def aside(self, metre: float) -> Float:
        """Return how far (3,) beside the blade's middle the camera is aimed."""
        return _column(metre, self.grid_m, self.aside_w)

    def target(self, metre: float) -> Float:
        """Return the point (3,) that the camera is aimed at."""
        return self.foot(metre) + self.centre(metre) + self.aside(metre)

    def position(self, metre: float) -> Float:
        """Return where the vehicle is (3,) when it looks at a metre."""
        return self.foot(metre) + self.centre(metre) + self.distance_at(metre) * self.view_w

    def metre_of(self, position_w: Float) -> float:
        """Return the metre that a vehicle at a position (3,) looks at."""
        along = float((position_w - self.root_w) @ self.axis_w)
        lean = float(self.view_w @ self.axis_w)
        return along - lean * self.distance_at(along) if abs(lean) > 1e-6 else along

    def line(self) -> Float:
        """Return the polyline (K, 3) from the first to the last photo."""
        first, last = self.photos[0], self.photos[-1]
        count = max(2, math.ceil(abs(last - first)) + 1)
        return np.stack([self.position(float(m)) for m in np.linspace(first, last, count)])

    def reversed(self) -> Leg:
        """Return the same line flown the other way."""
        return self.with_photos(self.photos[::-1], self.again)

    def with_photos(self, photos: tuple[float, ...], again: bool) -> Leg:
        """Return the same line with other photos."""
        return replace(self, photos=photos, again=again)

    @cached_property
    def spacing_m(self) -> float:
        """Metres between two photos."""
        apart = [abs(b - a) for a, b in itertools.pairwise(self.photos)]
        return min([self.footprint_m, *apart])


@dataclass(frozen=True, slots=True)
class Unseen:
    """A stretch that no admissible view shows, and why."""

    from_m: float
    to_m: float
    reason: str


@dataclass(frozen=True, slots=True)
class SidePass:
    """All that is flown of one side of one blade."""

    blade: str
    side: str
    legs: tuple[Leg, ...]
    unseen: tuple[Unseen, ...]
    planned_m: float
    """Metres of the blade that the legs show."""
    length_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """What a view is judged by."""

    model: RotorModel
    settings: Settings
    ground_m: float
    lean_w: Float


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    turn_deg: int
    slant_deg: int
    view_w: Float
    blind: bool
    distance_m: Float
    """(M,); NaN where the stretch cannot be flown."""
    reason: tuple[str, ...]
    """Per metre: what forbids it; empty where nothing does."""

    @property
    def seen(self) -> Mask:
        return np.isfinite(self.distance_m)

    @property
    def worth(self) -> float:
        cosine = math.cos(math.radians(self.turn_deg)) * math.cos(math.radians(self.slant_deg))
        worth = float(np.interp(math.degrees(math.acos(cosine)), WORTH_ANGLE_DEG, WORTH))
        return BLIND_WORTH * worth if self.blind else worth


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
    views = _views(frame, straight, turns, (0,), section, around)
    if not any(_sight(view.view_w, around) for view in views):
        views += _views(frame, straight, turns, SLANTS_DEG, section, around)
    best = max(views, key=lambda v: v.worth * int(v.seen.sum()) * _nearness(v))
    chosen = [(best, best.seen)]
    second = _second(frame, straight, turns, section, around, best)
    if second is not None:
        chosen.append((second, second.seen))
    legs = tuple(
        leg
        for view, mask in chosen
        for a, b in _runs(mask)
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
    best: _View,
) -> _View | None:
    """Return the view that shows most of the longest stretch that the best one leaves unseen.

    Near the root it mostly leans along the blade: from farther out one sees in under the nacelle.
    """
    grid = section.grid_m
    runs = _runs(~best.seen)
    if not runs:
        return None
    a, b = max(runs, key=lambda run: run[1] - run[0])
    if b - a + 1 < max(MIN_STRETCH_M, MIN_GAIN * len(grid)):
        return None
    views = _views(frame, straight_w, turns, (0, *SLANTS_DEG), section.part(a, b + 1), around)
    view = max(views, key=lambda v: v.worth * int(v.seen.sum()))
    if view.seen.sum() < max(MIN_STRETCH_M, MIN_GAIN * len(grid)):
        return None
    distance = np.full(len(grid), np.nan)
    distance[a : b + 1] = view.distance_m
    return replace(view, distance_m=distance, reason=best.reason)


def _nearness(view: _View) -> float:
    """Return what the view's distance is worth: 1 at the wanted one, less from farther away."""
    seen = view.seen
    return float((12.0 / view.distance_m[seen]).mean()) if seen.any() else 0.0


def _views(
    frame: BladeFrame,
    straight_w: Float,
    turns: Sequence[int],
    slants: Sequence[int],
    section: Section,
    around: Around,
) -> list[_View]:
    """Judge every view at every distance and metre."""
    model, settings, tracking = around.model, around.settings, around.settings.tracking
    distances: Float = np.arange(
        tracking.distance_m, tracking.max_distance_m + 1e-6, 1.0, dtype=np.float64
    )
    angles = [(turn, slant) for slant in slants for turn in turns]
    views = [
        math.cos(math.radians(slant)) * turned(straight_w, frame.axis_w, math.radians(turn))
        + math.sin(math.radians(slant)) * frame.axis_w
        for turn, slant in angles
    ]
    sees = [_sight(view_w, around) for view_w in views]
    if 0 not in slants:
        # Slanted views serve the gimbal alone: those that do not help need no judging.
        angles = [angle for angle, seen in zip(angles, sees, strict=True) if seen]
        views = [view_w for view_w, seen in zip(views, sees, strict=True) if seen]
        sees = [_sight(view_w, around) for view_w in views]
        if not views:
            return []
    grid = section.grid_m
    feet = frame.root_w + grid[:, None] * frame.axis_w
    middles = np.stack([feet + section.centre(view_w) for view_w in views])
    offsets = np.stack(views)[:, None, :] * distances[None, :, None]
    points = (offsets[:, :, None, :] + middles[:, None, :, :]).reshape(-1, 3)
    parts = model.part_distances(points) - settings.airframe.radius_m
    # What is not the blade itself is judged as that much nearer.
    others = np.array([each is not frame for each in model.frames] + [True, False, False])
    parts = parts - (OTHERS_MARGIN_M - TRACKING_MARGIN_M) * others
    shape = (len(angles), len(distances), len(grid))
    clearance = parts.min(axis=1).reshape(shape)
    nearest = parts.argmin(axis=1).reshape(shape)
    low = (points[:, 2] < around.ground_m + GROUND_MARGIN_M).reshape(shape)
    clear = (clearance >= settings.guard.min_clearance_m + TRACKING_MARGIN_M) & ~low
    found = []
    least_m = settings.guard.min_clearance_m + TRACKING_MARGIN_M
    far = distances >= BLIND_DISTANCE_M - 1e-6
    for index, ((turn, slant), view_w) in enumerate(zip(angles, views, strict=True)):
        blind = sees[index] == "blind"
        flyable = clear[index] & bool(sees[index])
        if blind:
            flyable &= far[:, None] & (clearance[index] >= least_m + BLIND_MARGIN_M)
        profile = _profile(flyable, distances)
        reason = _reasons(model, clearance[index], nearest[index], low[index], bool(sees[index]))
        found.append(_View(turn, slant, view_w, blind, profile, reason))
    return found


def _sight(view_w: Float, around: Around) -> str:
    """Return "seen" where gimbal and LiDAR see along a view, "blind" where only the gimbal does.

    Empty: not even the gimbal can look there.
    """
    elevation = math.degrees(math.asin(max(-1.0, min(1.0, -float(view_w[2])))))
    gimbal, lidar = around.settings.gimbal, around.settings.lidar
    # Two degrees are left for the vehicle's wander.
    low = max(gimbal.min_pitch_deg + 2, STEEPEST_DEG)
    if not low <= elevation <= gimbal.max_pitch_deg - 2:
        return ""
    # The nose faces the blade: what the LiDAR sees ahead is its own band, turned nose-down, and
    # more so by how the airframe leans into the wind.
    flat = math.hypot(float(view_w[0]), float(view_w[1]))
    ahead = -view_w[:2] / flat if flat > 1e-6 else np.zeros(2)
    down = lidar.nose_down_deg + math.degrees(
        math.atan2(float(around.lean_w[:2] @ ahead), float(around.lean_w[2]))
    )
    lowest, highest = lidar.min_elevation_deg - down, lidar.max_elevation_deg - down
    seen = lowest + WOBBLE_DEG <= elevation <= highest - WOBBLE_DEG
    return "seen" if seen else "blind"


def _profile(clear: Mask, distances: Float) -> Float:
    """Return the least clear distance (M,) per metre, its slope bounded; NaN where none."""
    reachable: Mask = np.asarray(clear.any(axis=0))
    least = np.where(reachable, distances[clear.argmax(axis=0)], np.nan)
    profile = least.copy()
    for a, b in _runs(reachable):
        metres = np.arange(b - a + 1)
        apart = np.abs(metres[:, None] - metres[None, :])
        profile[a : b + 1] = (least[a : b + 1][None, :] - MAX_SLOPE * apart).max(axis=1)
    # The smoothed distance must itself be clear, on both of its neighbours in the grid.
    position = np.nan_to_num((profile - distances[0]) / max(distances[-1] - distances[0], 1e-9))
    position *= len(distances) - 1
    columns = np.arange(clear.shape[1])
    both = (
        clear[np.floor(position + 1e-9).astype(int), columns]
        | (np.abs(position - np.ceil(position - 1e-9)) < 1e-6)
    ) & clear[np.ceil(position - 1e-9).astype(int), columns]
    return np.where(reachable & both, profile, np.nan)


def _reasons(
    model: RotorModel, clearance: Float, nearest: NDArray[np.intp], low: Mask, gimbal: bool
) -> tuple[str, ...]:
    """Name per metre what forbids the view where it is least forbidden."""
    if not gimbal:
        return ("the gimbal would lose the blade",) * clearance.shape[1]
    names = [f"blade {frame.name}" for frame in model.frames] + ["tower", "nacelle", "hub"]
    best = clearance.argmax(axis=0)
    words = []
    for metre, distance in enumerate(best):
        if low[distance, metre]:
            words.append("too near the ground")
        else:
            words.append(f"less than the clearance to {names[nearest[distance, metre]]}")
    return tuple(words)


def _runs(mask: Mask) -> list[tuple[int, int]]:
    """Return the first and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _legs(
    frame: BladeFrame,
    side: str,
    view: _View,
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
    )  # fmt: skip
    if not rows.any():
        return [one]
    first, last = float(grid[rows][0]), float(grid[rows][-1])
    other = photo_metres(max(first, float(grid[0])), max(last, first + 0.1), footprint, overlap)
    if len(other) < LEAST_ROW:
        return [replace(one, aside_w=np.zeros_like(one.aside_w))]
    return [one, replace(one, photos=other, aside_w=-one.aside_w)]


class Section:
    """The chord along a blade, as a viewer sees it."""

    def __init__(self, frame: BladeFrame, turbine: Turbine, grid_m: Float) -> None:
        """``grid_m``: (M,) metres."""
        shape, share = turbine.blade, grid_m / frame.length_m
        pitch = frame.pitch_rad or 0.0
        chord, twist, thickness, prebend, axis = (
            np.interp(share, shape.span, column)
            for column in (
                shape.chord_m, shape.twist_deg, shape.thickness, shape.prebend_m, shape.pitch_axis
            )
        )  # fmt: skip
        self._turbine = turbine
        angles = pitch + np.radians(twist)
        lead = np.cos(angles)[:, None] * frame.rotation_w + np.sin(angles)[:, None] * frame.upwind_w
        self.grid_m = grid_m
        self._frame = frame
        self._bend_w = prebend[:, None] * frame.pressure(pitch)
        self._middle_w = ((axis - 0.5) * chord)[:, None] * lead
        self._half_chord_w = 0.5 * chord[:, None] * lead
        self._half_thick_m = 0.5 * chord * thickness

    def part(self, first: int, end: int) -> Section:
        """Return a stretch of the grid by itself."""
        return Section(self._frame, self._turbine, self.grid_m[first:end])

    def across(self, view_w: Float) -> Float:
        """Return the unit direction (3,) across the blade, square to the view."""
        across: Float = np.asarray(np.cross(self._frame.axis_w, view_w), np.float64)
        return across / float(np.linalg.norm(across))

    def centre(self, view_w: Float) -> Float:
        """Return (M, 3) from the undeflected axis to the middle of what is seen."""
        across = self.across(view_w)
        return np.asarray(self._bend_w + (self._middle_w @ across)[:, None] * across, np.float64)

    def half_width(self, view_w: Float) -> Float:
        """Return (M,) half of the blade's extent across the view."""
        across = self.across(view_w)
        along = np.abs(self._half_chord_w @ across)
        # An ellipse of chord and thickness, turned: never less than its thickness.
        chord = np.linalg.norm(self._half_chord_w, axis=1)
        sine = np.sqrt(np.maximum(1 - (along / np.maximum(chord, 1e-6)) ** 2, 0.0))
        return np.asarray(np.hypot(along, sine * self._half_thick_m), np.float64)


def _column(metre: float, grid_m: Float, values: Float) -> Float:
    return np.array([np.interp(metre, grid_m, values[:, k]) for k in range(3)])


def _unseen(missing: Mask, grid: Float, view: _View) -> list[Unseen]:
    """Merge neighbouring metres of one reason; half a metre to each side belongs to the gap."""
    gaps: list[Unseen] = []
    step = float(grid[1] - grid[0])
    for a, b in _runs(missing):
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
