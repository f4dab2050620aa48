"""Two visits to the same physical blades, side by side, photo by photo at the same metre."""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from urllib.parse import quote

from mission.records.files import COMPARISON, write_whole
from mission.records.mission_file import MissionFile, PassPart, PhotoPart, read_mission
from mission.records.photo_record import NotARecord, PhotoRecord, read_record
from mission.records.report import picture_data, read_picture, render, thumbnail_data
from mission.records.report_facts import local, told_in
from mission.records.turned_photo import shown_m, turned

#: Photos of two visits show the same place when their metres are this near.
SAME_M = 1.5
PICTURE_PX = 480
#: Turned along the blade: width and height.
TURNED_PX = (600, 330)
#: Of the stretch that a photo shows: what the other shows beside the middle is seen too.
WIDER = 1.2
MAX_PAGE_BYTES = 14_000_000
_MOST_PICTURE_BYTES = 40_000


class NotComparable(ValueError):
    """The two missions do not show the same physical blades."""


@dataclass(frozen=True, slots=True)
class Shot:
    """One photo of one visit."""

    photo: PhotoPart
    link: str
    data: str
    """JPEG, base64; empty: the file is gone."""
    turned: bool
    """Root to the left, about the pair's metre; else the photo as it was taken."""


@dataclass(frozen=True, slots=True)
class Pair:
    """The same place in both visits; None: that visit has no photo there."""

    metre: float
    stretch: tuple[float, float] | None
    """The metres that both pictures show, left to right; None: not known of either."""
    newer: Shot | None
    older: Shot | None


@dataclass(frozen=True, slots=True)
class SidePair:
    """One side of one physical blade in both visits."""

    serial: str
    side: str
    newer_blade: str
    older_blade: str
    newer: PassPart | None
    older: PassPart | None
    pairs: tuple[Pair, ...]


def write_comparison(folder: Path, older_folder: Path) -> Path:
    """Render `comparison.html` into the newer mission's folder and return its path.

    Raises `NotAMission` or `NotComparable`.
    """
    newer, older = read_mission(folder), read_mission(older_folder)
    blades = _same_blades(newer, older)
    matched = {
        (serial, side): _matched(newer, older, mine, theirs, side)
        for serial, (mine, theirs) in blades.items()
        for side in ("PS", "SS", "LE", "TE")
    }
    count = sum((a is not None) + (b is not None) for pairs in matched.values() for a, b in pairs)
    # Base64 makes four bytes of three.
    budget = min(_MOST_PICTURE_BYTES, int(MAX_PAGE_BYTES * 0.75 / max(count, 1)))
    sides = []
    for (serial, side), pairs in matched.items():
        mine, theirs = blades[serial]
        shots = tuple(_pair(folder, older_folder, a, b, budget) for a, b in pairs)
        flown = _pass(newer, mine, side), _pass(older, theirs, side)
        if flown != (None, None):
            sides.append(SidePair(serial, side, mine, theirs, *flown, shots))
    page = render(
        told_in(folder),
        "comparison.html.j2",
        newer=newer,
        older=older,
        newer_date=_date(newer),
        older_date=_date(older),
        sides=sides,
    )
    path = folder / COMPARISON
    write_whole(path, page.encode())
    return path


def _date(mission: MissionFile) -> str:
    moment: datetime = mission.started_utc
    return local(moment, mission.inspection.time_zone)


def _same_blades(newer: MissionFile, older: MissionFile) -> dict[str, tuple[str, str]]:
    """Return the blade's name in either visit, by serial number."""
    mine, theirs = newer.inspection.blade_serials, older.inspection.blade_serials
    for name, serials in (("newer", mine), ("older", theirs)):
        if not serials:
            raise NotComparable(
                f"the {name} mission does not say which blades it shows: set blade_serials of the "
                "site (A, B, C) before a flight, and visits can be compared"
            )
    names = {serial: name for name, serial in theirs.items()}
    same = {
        serial: (name, names[serial]) for name, serial in sorted(mine.items()) if serial in names
    }
    if not same:
        raise NotComparable(
            "the missions show different blades: "
            f"{', '.join(sorted(mine.values()))} and {', '.join(sorted(theirs.values()))}"
        )
    return same


def _pass(mission: MissionFile, blade: str, side: str) -> PassPart | None:
    return next((p for p in mission.passes if (p.blade, p.side) == (blade, side)), None)


def _kept(mission: MissionFile, blade: str, side: str) -> list[PhotoPart]:
    mine = (p for p in mission.photo_list if p.kept and (p.blade, p.side) == (blade, side))
    return sorted(mine, key=lambda photo: photo.metre)


def _matched(
    newer: MissionFile, older: MissionFile, blade: str, older_blade: str, side: str
) -> list[tuple[PhotoPart | None, PhotoPart | None]]:
    """Pair the photos of a side, each with the nearest of the other visit, root first."""
    theirs = _kept(older, older_blade, side)
    pairs: list[tuple[PhotoPart | None, PhotoPart | None]] = []
    used: set[str] = set()
    for photo in _kept(newer, blade, side):
        nearest = min(theirs, key=lambda one: abs(one.metre - photo.metre), default=None)
        if nearest is not None and abs(nearest.metre - photo.metre) <= SAME_M:
            used.add(nearest.file)
            pairs.append((photo, nearest))
        else:
            pairs.append((photo, None))
    pairs += [(None, photo) for photo in theirs if photo.file not in used]
    return sorted(pairs, key=_metre)


def _metre(pair: tuple[PhotoPart | None, PhotoPart | None]) -> float:
    return next(photo.metre for photo in pair if photo is not None)


def _pair(
    folder: Path, older_folder: Path, mine: PhotoPart | None, theirs: PhotoPart | None, budget: int
) -> Pair:
    """Return both photos of a place, where that can be told as the same stretch of the blade."""
    both = [
        None if one is None else _Source(one, at / one.file, _record(at / one.file))
        for at, one in ((folder, mine), (older_folder, theirs))
    ]
    given = [one for one in both if one is not None]
    metre = sum(one.photo.metre for one in given) / len(given)
    shown = [m for one in given if one.record is not None and (m := shown_m(one.record))]
    span = WIDER * min(shown) if shown else None
    newer, older = (
        None if one is None else _shot(one, folder, _Stretch(metre, span), budget) for one in both
    )
    known = span is not None and any(one is not None and one.turned for one in (newer, older))
    stretch = (metre - span / 2, metre + span / 2) if span is not None and known else None
    return Pair(metre, stretch, newer, older)


@dataclass(frozen=True, slots=True)
class _Source:
    photo: PhotoPart
    path: Path
    record: PhotoRecord | None


@dataclass(frozen=True, slots=True)
class _Stretch:
    metre: float
    span_m: float | None


def _record(path: Path) -> PhotoRecord | None:
    try:
        return read_record(path)
    except NotARecord:
        return None


def _shot(one: _Source, page_folder: Path, stretch: _Stretch, budget: int) -> Shot:
    link = quote(os.path.relpath(one.path, page_folder))
    if one.record is not None and stretch.span_m is not None:
        picture = read_picture(one.path, max(TURNED_PX))
        seen = (
            None
            if picture is None
            else turned(picture, one.record, stretch.metre, stretch.span_m, TURNED_PX)
        )
        if seen is not None:
            return Shot(one.photo, link, picture_data(seen, budget), turned=True)
    data = thumbnail_data(one.path, PICTURE_PX, budget)
    return Shot(one.photo, link, data, turned=False)
