"""Which photos are taken once more: those that exist and are kept, yet are not exposed right."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mission.records.files import write_whole
from mission.records.photo_record import PhotoRecord

#: No more than this share of a mission's photos, and always so many: a camera whose photos do not
#: share the live picture's exposure would have everything flown twice.
MOST_SHARE, MOST_AT_LEAST = 0.05, 3
#: Words of the camera's own limit in a photo's marks: another photo would be no better.
LIMIT = "limit"
#: A second shot is taken where it shows most of the skin that the first one would have shown: its
#: middle lies this near, nearer than the next photo of a pass does.
SAME_M = 1.2


def asks_again(record: PhotoRecord, asked: int, stored: int, *, repeated: bool) -> str:
    """Return why a photo shall be taken once more, empty: it need not be.

    ``asked``: how many photos were asked for again so far, of ``stored``; ``repeated``: this one
    is a second shot already.
    """
    if repeated or not record.kept or record.exposure_in_range is not False:
        return ""
    if LIMIT in record.marks or asked >= max(MOST_AT_LEAST, MOST_SHARE * stored):
        return ""
    return f"grey {record.mean_grey:.0f} is out of range: kept, and taken once more"


def superseded(records: Sequence[PhotoRecord]) -> tuple[PhotoRecord, ...]:
    """Return all records, those out of range rejected of which another photo shows the place.

    Where no second shot came, or none in range, the photo stays kept: it is the best there is.
    """
    right = [one for one in records if one.kept and one.exposure_in_range]
    found = []
    for record in records:
        if record.kept and record.exposure_in_range is False and LIMIT not in record.marks:
            better = next((one for one in right if _shows_the_same(one, record)), None)
            if better is not None:
                words = f"out of the range of exposure; {better.file} shows the same"
                record = record.model_copy(update={"kept": False, "reason": words})
        found.append(record)
    return tuple(found)


def _shows_the_same(one: PhotoRecord, other: PhotoRecord) -> bool:
    same = (one.blade, one.side) == (other.blade, other.side)
    return same and abs(one.metre - other.metre) < SAME_M


def rewrite(folder: Path, records: Sequence[PhotoRecord]) -> None:
    """Write records anew beside their photos in a mission's folder."""
    for record in records:
        write_whole((folder / record.file).with_suffix(".json"), record.sidecar())
