"""Findings from outside (a person's list, a detector's output) put on the mission's blades.

CSV: a header and a line a finding. Where it is: `photo` with `x`, `y` (and `x2`, `y2`) in its
pixels, or `blade`, `side` and `metre` (and `chord`, 0 leading edge to 1 trailing edge). What it
is: `type`, `severity` (1 cosmetic to 5 critical), `size_mm`, `text`. COCO: its annotations by
image file name and box, `severity` beside the box or among its attributes.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from config.errors import first_fault
from config.inspection import BladeName, Side
from mission.records.files import PHOTOS
from mission.records.locate import Located, OutsidePicture, locate
from mission.records.photo_record import NotARecord, read_record


class BadFindings(ValueError):
    """The file of findings cannot be used; the message names file and line."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding on a blade."""

    number: int
    """From 1, worst first."""
    kind: str
    severity: int
    """1 cosmetic to 5 critical."""
    blade: str
    side: str
    metre: float
    chord: float | None
    """Share of the chord from the leading edge; None: not known."""
    size_mm: float | None
    photo: str
    """Relative to the mission folder; empty: none was named."""
    text: str


class _Row(BaseModel):
    model_config = ConfigDict(extra="ignore", str_strip_whitespace=True)
    type: Annotated[str, Field(min_length=1)]
    severity: Annotated[int, Field(ge=1, le=5)]
    size_mm: Annotated[float, Field(ge=0)] | None = None
    text: str = ""
    photo: str = ""
    x: float | None = None
    y: float | None = None
    x2: float | None = None
    y2: float | None = None
    blade: BladeName | None = None
    side: Side | None = None
    metre: Annotated[float, Field(ge=0, le=200)] | None = None
    chord: Annotated[float, Field(ge=0, le=1)] | None = None


class _CocoImage(BaseModel):
    id: int
    file_name: str
    width: float | None = None


class _CocoCategory(BaseModel):
    id: int
    name: str


class _CocoAttributes(BaseModel):
    severity: int | None = None
    text: str = ""


class _CocoBox(BaseModel):
    image_id: int
    category_id: int
    bbox: tuple[float, float, float, float]
    severity: int | None = None
    attributes: _CocoAttributes = _CocoAttributes()


class _Coco(BaseModel):
    images: tuple[_CocoImage, ...]
    annotations: tuple[_CocoBox, ...]
    categories: tuple[_CocoCategory, ...]


def read_findings(path: Path, folder: Path) -> list[Finding]:
    """Return the findings of a CSV or COCO file on a mission's blades. Raises `BadFindings`."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise BadFindings(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise BadFindings(f"{path} is no text in UTF-8") from error
    rows = _coco_rows(path, text, folder) if path.suffix == ".json" else _csv_rows(path, text)
    found = [_placed(row, f"{path}, {where}", folder) for where, row in rows]
    ordered = sorted(found, key=lambda one: (-one.severity, one.blade, one.side, one.metre))
    return [replace(one, number=number) for number, one in enumerate(ordered, 1)]


def _csv_rows(path: Path, text: str) -> list[tuple[str, _Row]]:
    rows = []
    reader = csv.DictReader(text.splitlines())
    for values in reader:
        given = {key.strip(): value for key, value in values.items() if key and value}
        where = f"line {reader.line_num}"
        rows.append((where, _row(given, f"{path}, {where}")))
    if not rows and "type" not in (reader.fieldnames or ()):
        raise BadFindings(f"{path} holds no findings: its first line shall name the columns")
    return rows


def _coco_rows(path: Path, text: str, folder: Path) -> list[tuple[str, _Row]]:
    try:
        coco = _Coco.model_validate(json.loads(text))
    except ValidationError as error:
        raise BadFindings(f"{path} is not COCO: {first_fault(error)}") from error
    except ValueError as error:
        raise BadFindings(f"{path} is not JSON: {error}") from error
    images = {image.id: image for image in coco.images}
    kinds = {category.id: category.name for category in coco.categories}
    rows = []
    for number, one in enumerate(coco.annotations, 1):
        where = f"annotation {number}"
        image = images.get(one.image_id)
        if image is None:
            raise BadFindings(f"{path}, {where}: there is no image {one.image_id}")
        x, y, width, high = one.bbox
        scale = _stored_scale(folder, image, f"{path}, {where}")
        given = {
            "type": kinds.get(one.category_id, f"category {one.category_id}"),
            "severity": one.severity or one.attributes.severity or 1,
            "text": one.attributes.text,
            "photo": image.file_name,
            "x": x * scale,
            "y": y * scale,
            "x2": (x + width) * scale,
            "y2": (y + high) * scale,
        }
        rows.append((where, _row(given, f"{path}, {where}")))
    return rows


def _stored_scale(folder: Path, image: _CocoImage, where: str) -> float:
    """Return stored pixels per pixel of the annotated picture, which may have been reduced."""
    if not image.width:
        return 1.0
    photo = _photo(image.file_name, folder, where)
    try:
        return read_record(photo).width_px / image.width
    except NotARecord as error:
        raise BadFindings(f"{where}: {error}") from error


def _row(given: Mapping[str, object], where: str) -> _Row:
    try:
        return _Row.model_validate(given)
    except ValidationError as error:
        raise BadFindings(f"{where}: {first_fault(error)}") from error


def _placed(row: _Row, where: str, folder: Path) -> Finding:
    if row.photo and row.x is not None and row.y is not None:
        return _placed_by_photo(row, where, folder)
    if row.blade is None or row.side is None or row.metre is None:
        raise BadFindings(f"{where}: say where it is: photo, x and y, or blade, side and metre")
    photo = str(_photo(row.photo, folder, where).relative_to(folder)) if row.photo else ""
    return Finding(
        0,
        row.type,
        row.severity,
        row.blade,
        row.side,
        row.metre,
        row.chord,
        row.size_mm,
        photo,
        row.text,
    )


def _placed_by_photo(row: _Row, where: str, folder: Path) -> Finding:
    photo = _photo(row.photo, folder, where)
    one = (row.x or 0.0, row.y or 0.0)
    other = None if row.x2 is None or row.y2 is None else (row.x2, row.y2)
    middle = one if other is None else ((one[0] + other[0]) / 2, (one[1] + other[1]) / 2)
    try:
        located = locate(photo, middle, None)
        spread = None if other is None else locate(photo, one, other)
        record = read_record(photo)
    except (NotARecord, OutsidePicture) as error:
        raise BadFindings(f"{where}: {error}") from error
    place = located.place
    return Finding(
        0,
        row.type,
        row.severity,
        located.blade,
        _side(located),
        record.metre if place.metre is None else place.metre,
        place.chord_share,
        row.size_mm if row.size_mm is not None or spread is None else spread.length_mm,
        str(photo.relative_to(folder)),
        row.text,
    )


def _side(located: Located) -> Literal["PS", "SS", "LE", "TE"]:
    sides: dict[str, Literal["PS", "SS", "LE", "TE"]]
    sides = {"PS": "PS", "SS": "SS", "LE": "LE", "TE": "TE"}
    return sides[located.side]


def _photo(name: str, folder: Path, where: str) -> Path:
    """Return the photo of a name: a path in the folder, or a file's bare name."""
    direct = folder / name
    if direct.is_file() and direct.resolve().is_relative_to(folder.resolve()):
        return direct
    found = list((folder / PHOTOS).rglob(Path(name).name)) if name else []
    if len(found) != 1:
        raise BadFindings(f"{where}: the mission has no photo {name}")
    return found[0]
