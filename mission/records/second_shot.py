"""Which photos are taken once more: those that exist and are kept, yet are not exposed right."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mission.records.files import write_whole
from mission.records.photo_record import PhotoRecord
from mission.records.skin_map import skin_map

#: No more than this share of a mission's photos, and always so many: a camera whose photos do not
#: share the live picture's exposure would have everything flown twice.
MOST_SHARE, MOST_AT_LEAST = 0.05, 3
#: Words of the camera's own limit in a photo's marks: another photo would be no better.
LIMIT = "limit"
#: A second shot is taken where it shows most of the skin that the first one would have shown: its
#: middle lies this near, nearer than the next photo of a pass does.
SAME_M = 1.2
#: Of the skin that a photo shows, as much may be in no other: as the flight has it of a leg.
ALONE_SHARE = 0.01


def asks_again(record: PhotoRecord, asked: int, stored: int, *, repeated: bool) -> str:
    """Return why a photo shall be taken once more, empty: it need not be.

    ``asked``: how many photos were asked for again so far, of ``stored``; ``repeated``: this one
    is a second shot already.
    """
    if repeated or not _wrong(record):
        return ""
    if asked >= max(MOST_AT_LEAST, MOST_SHARE * stored):
        return ""
    over_all = "" if record.blade_grey is None else f", {record.blade_grey:.0f} over all of it"
    return f"grey {record.mean_grey:.0f}{over_all} is out of range: kept, and taken once more"


def superseded(records: Sequence[PhotoRecord], max_gsd_mm: float) -> tuple[PhotoRecord, ...]:
    """Return all records, those out of range rejected of which others in range show the place.

    Where no second shot came, or none in range, the photo stays kept: it is the best there is.
    ``max_gsd_mm``: as fine as skin has to be shown.
    """
    right = [one for one in records if one.kept and one.exposure_in_range]
    found = []
    for record in records:
        if _wrong(record):
            better = next((one for one in right if _shows_the_same(one, record)), None)
            words = "" if better is None else f"{better.file} shows the same"
            if better is None and _shown_by(right, record, max_gsd_mm):
                words = "others show all that it does"
            if words:
                words = f"out of the range of exposure; {words}"
                record = record.model_copy(update={"kept": False, "reason": words})
        found.append(record)
    return tuple(found)


def _wrong(record: PhotoRecord) -> bool:
    """Return whether a photo is kept and out of range, and the camera could have done better."""
    return record.kept and record.exposure_in_range is False and LIMIT not in record.marks


def _shows_the_same(one: PhotoRecord, other: PhotoRecord) -> bool:
    same = (one.blade, one.side) == (other.blade, other.side)
    return same and abs(one.metre - other.metre) < SAME_M


def _shown_by(right: Sequence[PhotoRecord], record: PhotoRecord, max_gsd_mm: float) -> bool:
    """Return whether photos in range show all skin of a photo's side that it shows."""
    length_m = None if record.view is None else record.view.blade_length_m
    others = [one for one in right if one.blade == record.blade]
    if length_m is None or not others:
        return False

    def kept_alone(kept: Sequence[PhotoRecord]) -> list[PhotoRecord]:
        # All of them tell the blade's form, so that both maps have the same cells.
        return [
            one.model_copy(update={"kept": any(one is mine for mine in kept)})
            for one in (record, *others)
        ]

    mine = skin_map(kept_alone([record]), record.side, length_m, max_gsd_mm)
    theirs = skin_map(kept_alone(others), record.side, length_m, max_gsd_mm)
    if mine is None or theirs is None or not mine.seen.any():
        return False
    alone = mine.seen & ~theirs.seen
    return int(alone.sum()) <= ALONE_SHARE * int(mine.seen.sum())


def rewrite(folder: Path, records: Sequence[PhotoRecord]) -> None:
    """Write records anew beside their photos in a mission's folder."""
    for record in records:
        write_whole((folder / record.file).with_suffix(".json"), record.sidecar())
