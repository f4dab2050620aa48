"""The blade map: each side drawn to its outline, what was seen of it and how finely.

Pure arithmetic in the coordinates of one SVG picture a side: x runs from root to tip, y across
the chord, leading edge on top; on the edges' own passes y is the section's thickness.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mission.records.mission_file import MissionFile, PassPart, PhotoPart, ShapePart

WIDTH, MIDDLE, HALF_HEIGHT = 1000.0, 34.0, 27.0
_GRID_STEPS_M = (5, 10, 20, 25, 50)
_MOST_GRID_LINES = 9
_OUTLINE_STATIONS = 60
#: Finer than this looks the same on the map; the coarsest is where the wanted limit lies.
_FINE, _COARSE = (17, 66, 105), (148, 190, 219)
_TOO_COARSE = "#d68a2d"
#: A blade whose form is not known: round root, widest at a fifth, tapering.
_GENERIC = ShapePart(
    span=(0.0, 0.05, 0.2, 0.6, 0.95, 1.0),
    chord_m=(1.7, 1.7, 2.8, 1.7, 0.7, 0.15),
    thickness=(1.0, 1.0, 0.35, 0.2, 0.17, 0.17),
    pitch_axis=(0.5, 0.5, 0.37, 0.33, 0.3, 0.3),
)


@dataclass(frozen=True, slots=True)
class Cell:
    """A stretch of one side, in the picture's x."""

    x: float
    width: float
    words: str
    colour: str = ""


@dataclass(frozen=True, slots=True)
class Dot:
    """A photo, a metre of the axis or a finding, in the picture's x and y."""

    x: float
    y: float
    words: str
    kind: str = ""


@dataclass(frozen=True, slots=True)
class SideMap:
    """One side of one blade."""

    flown: PassPart
    outline: str
    """SVG polygon points."""
    seen: tuple[Cell, ...]
    missed: tuple[Cell, ...]
    """Planned, but in no kept photo."""
    unseen: tuple[Cell, ...]
    """Not planned: out of reach."""
    photos: tuple[Dot, ...]
    metres: tuple[Dot, ...]
    true_coverage: float | None


@dataclass(frozen=True, slots=True)
class NotInspected:
    """A stretch that no kept photo shows, and why."""

    blade: str
    side: str
    from_m: float
    to_m: float
    why: str


def side_maps(mission: MissionFile) -> list[SideMap]:
    """Return the map of every pass, in the order of blades and sides."""
    truth: Mapping[str, Mapping[str, float | None]]
    truth = {} if mission.truth is None else mission.truth.coverage
    shape = mission.blade_shape or _GENERIC
    limit_mm = mission.inspection.max_gsd_mm
    return [
        _side_map(
            one, _photos_of(mission, one), shape, limit_mm, truth.get(one.blade, {}).get(one.side)
        )
        for one in mission.passes
    ]


def _photos_of(mission: MissionFile, one: PassPart) -> list[PhotoPart]:
    place = (one.blade, one.side)
    return [photo for photo in mission.photo_list if (photo.blade, photo.side) == place]


def _side_map(
    one: PassPart,
    photos: Sequence[PhotoPart],
    shape: ShapePart,
    limit_mm: float | None,
    true_coverage: float | None,
) -> SideMap:
    scale = WIDTH / max(one.length_m, 1e-6)
    kept = sorted((p for p in photos if p.kept), key=lambda photo: photo.metre)
    seen = [
        Cell(scale * low, scale * (high - low), words, gsd_colour(gsd, limit_mm))
        for start, end in one.photographed_m
        for low, high, gsd, words in _by_nearest(start, end, kept)
    ]
    unseen = [
        Cell(scale * gap.from_m, scale * (gap.to_m - gap.from_m), gap.reason) for gap in one.unseen
    ]
    missed = [
        Cell(scale * low, scale * (high - low), f"{low:.1f} to {high:.1f} m: in no kept photo")
        for low, high in gaps_of(one)
    ]
    dots = [
        Dot(
            scale * min(max(photo.metre, 0.0), one.length_m),
            69.0,
            f"{photo.metre:.1f} m" + (f": {photo.reason}" if photo.reason else ""),
            "kept" if photo.kept else "rejected",
        )
        # Kept photos last, so that they lie over rejected ones.
        for photo in sorted(photos, key=lambda photo: photo.kept)
    ]
    fine = next((s for s in _GRID_STEPS_M if one.length_m / s <= _MOST_GRID_LINES), 50)
    metres = [Dot(scale * m, 84.0, str(m)) for m in range(0, int(one.length_m) + 1, fine)]
    return SideMap(
        one,
        _outline(shape, one.side),
        tuple(seen),
        tuple(missed),
        tuple(unseen),
        tuple(dots),
        tuple(metres),
        true_coverage,
    )


def _by_nearest(
    start: float, end: float, kept: Sequence[PhotoPart]
) -> list[tuple[float, float, float | None, str]]:
    """Cut a stretch where the nearest kept photo changes: (from, to, its GSD, words)."""
    if not kept:
        return [(start, end, None, f"{start:.1f} to {end:.1f} m")]
    edges = [(a.metre + b.metre) / 2 for a, b in itertools.pairwise(kept)]
    bounds = [start, *(edge for edge in edges if start < edge < end), end]
    cells = []
    for low, high in itertools.pairwise(bounds):
        photo = min(kept, key=lambda one: abs(one.metre - (low + high) / 2))
        gsd = "" if photo.gsd_mm is None else f", {photo.gsd_mm:.2f} mm a pixel"
        cells.append((low, high, photo.gsd_mm, f"{low:.1f} to {high:.1f} m{gsd}"))
    return cells


def gsd_colour(gsd_mm: float | None, limit_mm: float | None) -> str:
    """Return the map's colour for a pixel's size: dark is fine, orange is above the limit."""
    limit = 1.5 if limit_mm is None else limit_mm
    if gsd_mm is None:
        return "#7d93a3"
    if gsd_mm > limit:
        return _TOO_COARSE
    share = min(max((gsd_mm / limit - 0.4) / 0.6, 0.0), 1.0)
    mixed = [round(a + share * (b - a)) for a, b in zip(_FINE, _COARSE, strict=True)]
    return "#" + "".join(f"{value:02x}" for value in mixed)


def gaps_of(one: PassPart) -> list[tuple[float, float]]:
    """Return what no kept photo shows of a side and was not out of reach: (from, to) metres."""
    covered = sorted([*one.photographed_m, *((gap.from_m, gap.to_m) for gap in one.unseen)])
    found, at = [], 0.0
    for low, high in covered:
        if low > at + 0.05:
            found.append((at, low))
        at = max(at, high)
    if one.length_m > at + 0.05:
        found.append((at, one.length_m))
    return found


def not_inspected(mission: MissionFile) -> list[NotInspected]:
    """Return everything that was asked for and not seen, and why; sides not asked for, too."""
    found = []
    for one in mission.passes:
        found += [
            NotInspected(one.blade, one.side, gap.from_m, gap.to_m, gap.reason)
            for gap in one.unseen
        ]
        photos = _photos_of(mission, one)
        found += [
            NotInspected(one.blade, one.side, low, high, _why(mission, one, photos, low, high))
            for low, high in gaps_of(one)
        ]
    return sorted(found, key=lambda gap: (gap.blade, gap.side, gap.from_m))


def _why(
    mission: MissionFile, one: PassPart, photos: Sequence[PhotoPart], low: float, high: float
) -> str:
    if one.skipped:
        return "the pass was skipped"
    rejected = [p for p in photos if not p.kept and low - 1.0 <= p.metre <= high + 1.0]
    if rejected:
        return f"photo rejected: {rejected[0].reason}"
    if not photos:
        ended = mission.state != "completed"
        return f"not flown: {mission.words}" if ended else "no photo was taken"
    return (
        "between two photos"
        if any(p.metre < low for p in photos) and any(p.metre > high for p in photos)
        else "beyond the first or last photo"
    )


def not_asked(mission: MissionFile) -> list[str]:
    """Return the sides of each blade that nobody asked for, as words."""
    flown = {(one.blade, one.side) for one in mission.passes}
    missing = {
        blade: [side for side in ("PS", "SS", "LE", "TE") if (blade, side) not in flown]
        for blade in "ABC"
    }
    return [f"blade {blade}: {', '.join(sides)}" for blade, sides in missing.items() if sides]


def _outline(shape: ShapePart, side: str) -> str:
    span = np.linspace(0.0, 1.0, _OUTLINE_STATIONS)
    chord = np.interp(span, shape.span, shape.chord_m)
    if side in ("PS", "SS"):
        above = chord * np.interp(span, shape.span, shape.pitch_axis)
        below = chord - above
    else:
        above = below = chord * np.interp(span, shape.span, shape.thickness) / 2
    # One scale for all sides: an edge is as much narrower as it is.
    widest = max(shape.chord_m)
    scale = 2 * HALF_HEIGHT / widest
    axis = (
        MIDDLE
        - HALF_HEIGHT
        + scale * float(np.max(np.array(shape.chord_m) * np.array(shape.pitch_axis)))
    )
    if side in ("LE", "TE"):
        axis = MIDDLE
    x = WIDTH * span
    top = [f"{a:.1f},{axis - scale * b:.1f}" for a, b in zip(x, above, strict=True)]
    bottom = [f"{a:.1f},{axis + scale * b:.1f}" for a, b in zip(x, below, strict=True)]
    return " ".join([*top, *reversed(bottom)])
