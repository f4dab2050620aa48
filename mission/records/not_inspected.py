"""What of the sides asked for is in no kept photo, and why: metres, and strips of skin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from mission.records.mission_file import MissionFile, PassPart, PhotoPart
from mission.records.photo_record import PhotoRecord
from mission.records.skin_map import BINS, ROWS, Bools, SkinMap, skin_map

LIMIT_MM = 1.5
"""The wanted GSD where a mission does not tell it."""
_LEAST_GAP_M = 1.0
_STRIPS = (
    ("towards the suction side", "along the edge", "towards the pressure side"),
    ("towards the leading edge", "along the middle", "towards the trailing edge"),
)
_WHY = (
    "beside every kept picture",
    "only in pictures that are too coarse",
    "only seen too flat, at more than 60°",
)
Skins: TypeAlias = Mapping[tuple[str, str], SkinMap]


@dataclass(frozen=True, slots=True)
class NotInspected:
    """A stretch that no kept photo shows, and why."""

    blade: str
    side: str
    from_m: float
    to_m: float
    why: str


def skins_of(mission: MissionFile, records: Sequence[PhotoRecord]) -> Skins:
    """Return the skin of every pass that the photos' records tell of, by blade and side."""
    limit_mm = mission.inspection.max_gsd_mm or LIMIT_MM
    found = {}
    for one in mission.passes:
        mine = [record for record in records if record.blade == one.blade]
        skin = skin_map(mine, one.side, one.length_m, limit_mm)
        if skin is not None:
            found[one.blade, one.side] = skin
    return found


def photos_of(mission: MissionFile, one: PassPart) -> list[PhotoPart]:
    """Return the photos of a pass."""
    place = (one.blade, one.side)
    return [photo for photo in mission.photo_list if (photo.blade, photo.side) == place]


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


def not_inspected(mission: MissionFile, skins: Skins | None = None) -> list[NotInspected]:
    """Return everything that was asked for and not seen, and why: metres, and strips of skin."""
    found = []
    for one in mission.passes:
        found += [
            NotInspected(one.blade, one.side, gap.from_m, gap.to_m, gap.reason)
            for gap in one.unseen
        ]
        photos = photos_of(mission, one)
        found += [
            NotInspected(one.blade, one.side, low, high, _why(mission, one, photos, low, high))
            for low, high in gaps_of(one)
        ]
        skin = (skins or {}).get((one.blade, one.side))
        if skin is not None:
            found += _skin_gaps(one, skin)
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


def _skin_gaps(one: PassPart, skin: SkinMap) -> list[NotInspected]:
    """Return where a strip of a side's skin is in no kept photo although its metres are."""
    named = [*gaps_of(one), *((gap.from_m, gap.to_m) for gap in one.unseen)]
    step = one.length_m / BINS
    metres = (np.arange(BINS) + 0.5) * step
    told = np.zeros(BINS, bool)
    for low, high in named:
        told |= (metres >= low) & (metres <= high)
    found = []
    for strip, rows in enumerate(np.array_split(np.arange(ROWS), 3)):
        mine, seen = skin.on_side[rows].sum(axis=0), skin.seen[rows].sum(axis=0)
        bad = (mine > 0) & (seen < 0.5 * mine) & ~told
        for begin, end in _runs(bad):
            if (end - begin) * step < _LEAST_GAP_M:
                continue
            cells = (skin.on_side & ~skin.seen)[rows, begin:end]
            why = int(np.bincount(skin.why[rows, begin:end][cells]).argmax())
            where = _STRIPS[one.side in ("PS", "SS")][strip]
            words = f"{where}: {_WHY[why]}"
            found.append(NotInspected(one.blade, one.side, begin * step, end * step, words))
    return found


def _runs(flags: Bools) -> list[tuple[int, int]]:
    """Return (begin, end) of the stretches that are set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
