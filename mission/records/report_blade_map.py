"""The blade map: each side drawn to its outline, what was seen of it and how finely.

Pure arithmetic in the coordinates of one SVG picture a side: x runs from root to tip, y across
the chord, leading edge on top; on the edges' own passes y is the section's thickness.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mission.records.findings import Finding
from mission.records.mission_file import MissionFile, PassPart, PhotoPart, ShapePart
from mission.records.not_inspected import LIMIT_MM, Skins, gaps_of, photos_of
from mission.records.skin_map import BINS, ROWS, SkinMap
from perception.values import Float

WIDTH, MIDDLE, HALF_HEIGHT = 1000.0, 34.0, 27.0
_GRID_STEPS_M = (5, 10, 20, 25, 50)
_MOST_GRID_LINES = 9
_OUTLINE_STATIONS = 60
_LEVELS = 10
"""Steps of colour up to the limit."""
_KNOTS = 5
"""A patch's edge follows the outline at every so many bins."""
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
class Patch:
    """A piece of one side's skin that looks the same."""

    path: str
    """Of SVG."""
    kind: str
    """`seen`, `missed` or `unseen` (out of reach)."""
    colour: str
    words: str


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
    skin: tuple[Patch, ...] = ()
    """The skin itself, where the photos' records tell of it; `seen` and the rest are then idle."""
    findings: tuple[Dot, ...] = ()
    """Each with its number and its severity, at its place on the chord where that is known."""


def skin_seen(mission: MissionFile, skins: Skins) -> float | None:
    """Return the share of the skin that kept photos show, of all sides asked for; None: unknown."""
    flown = [one for one in mission.passes if (one.blade, one.side) in skins]
    if not flown or len(flown) < len(mission.passes):
        return None
    length_m = sum(one.length_m for one in flown)
    return sum(one.coverage * one.length_m for one in flown) / max(length_m, 1e-6)


def side_maps(
    mission: MissionFile, skins: Skins | None = None, findings: Sequence[Finding] = ()
) -> list[SideMap]:
    """Return the map of every pass, in the order of blades and sides."""
    truth: Mapping[str, Mapping[str, float | None]]
    truth = {} if mission.truth is None else mission.truth.coverage
    shape = mission.blade_shape or _GENERIC
    limit_mm = mission.inspection.max_gsd_mm
    return [
        _side_map(
            one,
            photos_of(mission, one),
            shape,
            limit_mm,
            truth.get(one.blade, {}).get(one.side),
            (skins or {}).get((one.blade, one.side)),
            [found for found in findings if (found.blade, found.side) == (one.blade, one.side)],
        )
        for one in mission.passes
    ]


def _side_map(
    one: PassPart,
    photos: Sequence[PhotoPart],
    shape: ShapePart,
    limit_mm: float | None,
    true_coverage: float | None,
    skin: SkinMap | None,
    findings: Sequence[Finding],
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
        () if skin is None else _patches(one, skin, shape, limit_mm or LIMIT_MM),
        tuple(_finding(found, one, shape) for found in findings),
    )


def _finding(found: Finding, one: PassPart, shape: ShapePart) -> Dot:
    share = min(max(found.metre / max(one.length_m, 1e-6), 0.0), 1.0)
    top, bottom = (float(edge[0]) for edge in _edges(shape, one.side, np.array([share])))
    down = found.chord if found.chord is not None and one.side in ("PS", "SS") else 0.5
    return Dot(WIDTH * share, top + down * (bottom - top), str(found.number), f"s{found.severity}")


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
    limit = limit_mm or LIMIT_MM
    if gsd_mm is None:
        return "#7d93a3"
    if gsd_mm > limit:
        return _TOO_COARSE
    share = min(max((gsd_mm / limit - 0.4) / 0.6, 0.0), 1.0)
    mixed = [round(a + share * (b - a)) for a, b in zip(_FINE, _COARSE, strict=True)]
    return "#" + "".join(f"{value:02x}" for value in mixed)


def _edges(shape: ShapePart, side: str, span: Float) -> tuple[Float, Float]:
    """Return y of the outline's top and bottom (N,) at shares of the length (N,)."""
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
    return axis - scale * above, axis + scale * below


def _outline(shape: ShapePart, side: str) -> str:
    span: Float = np.linspace(0.0, 1.0, _OUTLINE_STATIONS, dtype=np.float64)
    top, bottom = _edges(shape, side, span)
    upper = [f"{x:.1f},{y:.1f}" for x, y in zip(WIDTH * span, top, strict=True)]
    lower = [f"{x:.1f},{y:.1f}" for x, y in zip(WIDTH * span, bottom, strict=True)]
    return " ".join([*upper, *reversed(lower)])


def _patches(one: PassPart, skin: SkinMap, shape: ShapePart, limit_mm: float) -> tuple[Patch, ...]:
    """Return the skin row by row, stretches that look the same as one patch."""
    edges: Float = np.linspace(0.0, 1.0, BINS + 1, dtype=np.float64)
    top, bottom = _edges(shape, one.side, edges)
    found = []
    for row in range(ROWS):
        begin = 0
        looks = [_look(one, skin, row, column, limit_mm) for column in range(BINS)]
        for column in range(1, BINS + 1):
            if column < BINS and looks[column] == looks[begin]:
                continue
            kind, level = looks[begin]
            if kind:
                knots = sorted({begin, *range(begin, column, _KNOTS), column})
                path = [
                    f"{WIDTH * edges[k]:.1f} {top[k] + share * (bottom[k] - top[k]):.1f}"
                    for share, order in ((row / ROWS, knots), ((row + 1) / ROWS, knots[::-1]))
                    for k in order
                ]
                low, high = (one.length_m * float(edges[k]) for k in (begin, column))
                words = f"{low:.1f} to {high:.1f} m"
                if kind == "seen":
                    words += f", {level * limit_mm / _LEVELS:.2f} mm a pixel"
                colour = gsd_colour(level * limit_mm / _LEVELS, limit_mm) if kind == "seen" else ""
                found.append(Patch("M" + "L".join(path) + "Z", kind, colour, words))
            begin = column
    return tuple(found)


def _look(one: PassPart, skin: SkinMap, row: int, column: int, limit_mm: float) -> tuple[str, int]:
    """Return how a cell is drawn: its kind, and the step of its GSD."""
    if not skin.on_side[row, column]:
        return "", 0
    if skin.seen[row, column]:
        return "seen", round(float(skin.gsd_mm[row, column]) / limit_mm * _LEVELS)
    metre = (column + 0.5) * one.length_m / BINS
    away = any(gap.from_m <= metre <= gap.to_m for gap in one.unseen)
    return ("unseen" if away else "missed"), 0
