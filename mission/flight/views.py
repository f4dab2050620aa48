"""From where a stretch of a blade can be seen: each view judged at every distance and metre.

Too near the tower, the nacelle, the ground or a neighbouring blade is not flown; where the gimbal
cannot look nothing is seen, and where the LiDAR does not see the blade it is flown farther away.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.settings import Settings
from mission.flight.rotor_model import RotorModel
from mission.flight.section import Section
from mission.flight.sides import BladeFrame, turned
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
#: How far gusts rock the airframe, and the LiDAR with it.
WOBBLE_DEG = 3.0
#: Steeper below the horizon than this the gimbal would have to turn over when the vehicle wanders.
STEEPEST_DEG = -76.0
#: Where the LiDAR does not see the blade, the vehicle flies on the fitted rotor: farther away, and
#: clearer of everything by so much.
BLIND_DISTANCE_M = 13.0
BLIND_MARGIN_M = 1.0
BLIND_WORTH = 0.85
#: What a view is worth by its angle off the straight one: skin that faces the side's own view is
#: then seen at a slant.
WORTH_ANGLE_DEG = (0.0, 15.0, 30.0, 45.0, 60.0)
WORTH = (1.0, 0.97, 0.88, 0.75, 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """What a view is judged by."""

    model: RotorModel
    settings: Settings
    ground_m: float
    lean_w: Float


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A direction to look from, and how near to the blade each metre can be flown there."""

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
        """Which metres (M,) can be flown."""
        return np.isfinite(self.distance_m)

    @property
    def worth(self) -> float:
        """What a metre seen from here is worth, beside 1 from straight on."""
        cosine = math.cos(math.radians(self.turn_deg)) * math.cos(math.radians(self.slant_deg))
        worth = float(np.interp(math.degrees(math.acos(cosine)), WORTH_ANGLE_DEG, WORTH))
        return BLIND_WORTH * worth if self.blind else worth


def judged_views(
    frame: BladeFrame,
    straight_w: Float,
    turns: Sequence[int],
    slants: Sequence[int],
    section: Section,
    around: Around,
) -> list[View]:
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
    sees = [sight(view_w, around) for view_w in views]
    if 0 not in slants:
        # Slanted views serve the gimbal alone: those that do not help need no judging.
        angles = [angle for angle, seen in zip(angles, sees, strict=True) if seen]
        views = [view_w for view_w, seen in zip(views, sees, strict=True) if seen]
        sees = [sight(view_w, around) for view_w in views]
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
        found.append(View(turn, slant, view_w, blind, profile, reason))
    return found


def sight(view_w: Float, around: Around) -> str:
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
    for a, b in runs_of(reachable):
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


def runs_of(mask: Mask) -> list[tuple[int, int]]:
    """Return the first and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
