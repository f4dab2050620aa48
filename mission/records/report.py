"""The report: one self-contained HTML page of a mission folder."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import cv2
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from numpy.typing import NDArray
from pydantic import ValidationError

from mission.records.files import EVENTS, REPORT, write_whole
from mission.records.mission_file import MissionFile, NotAMission, PhotoPart, read_mission
from mission.records.report_views import (
    clock,
    course,
    exposure_curves,
    grey_height,
    happenings,
    labelled,
    rotor_picture,
    strips,
)
from mission.remote.messages import EventMessage

__all__ = ["NotAMission", "write_report"]

THUMBNAIL_PX = 320
#: A page of 300 photos stays below 15 MB.
MAX_THUMBNAIL_BYTES = 30_000
_QUALITIES = (72, 50, 30, 10)
_NO_VALUE = "–"


@dataclass(frozen=True, slots=True)
class Thumbnail:
    """One photo of the contact sheet."""

    photo: PhotoPart
    data: str
    """JPEG, base64."""


@dataclass(frozen=True, slots=True)
class Sheet:
    """The photos of one side, root first; rejected ones by themselves."""

    blade: str
    side: str
    kept: tuple[Thumbnail, ...]
    rejected: tuple[Thumbnail, ...]


def write_report(folder: Path) -> Path:
    """Render `report.html` of a mission folder and return its path. Raises `NotAMission`."""
    mission = read_mission(folder)
    events = _events(folder / EVENTS)
    page = (
        _environment()
        .get_template("report.html.j2")
        .render(
            mission=mission,
            begin_s=mission.begin_s,
            rotor_picture=rotor_picture(mission),
            strips=strips(mission),
            curves=exposure_curves(mission),
            course=course(mission, events),
            happenings=happenings(events),
            events=events,
            sheets=_sheets(folder, mission),
        )
    )
    report = folder / REPORT
    write_whole(report, page.encode())
    return report


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("mission.records"),
        autoescape=select_autoescape(default=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["num"] = _number
    environment.filters["clock"] = clock
    environment.filters["grey_height"] = grey_height
    environment.filters["labelled"] = labelled
    return environment


def _number(value: float | None, digits: int = 1, unit: str = "", *, sign: bool = False) -> str:
    """Return a figure as printed; a dash where there is none."""
    if value is None:
        return _NO_VALUE
    # A figure that rounds to nothing has no sign.
    text = f"{round(value, digits) + 0.0:{'+' if sign else ''}.{digits}f}"
    return f"{text}{unit}".replace("-", "\N{MINUS SIGN}", 1)


def _events(path: Path) -> list[EventMessage]:
    """Read what can be read of the events: a line cut short is left out."""
    if not path.exists():
        return []
    events = []
    for line in path.read_text(errors="replace").splitlines():
        try:
            events.append(EventMessage.model_validate_json(line))
        except ValidationError:
            continue
    return events


def _sheets(folder: Path, mission: MissionFile) -> list[Sheet]:
    def place(photo: PhotoPart) -> tuple[str, str]:
        return photo.blade, photo.side

    photos = sorted(mission.photo_list, key=lambda photo: (*place(photo), photo.metre))
    sheets = []
    for (blade, side), group in groupby(photos, key=place):
        mine = [thumb for photo in group if (thumb := _thumbnail(folder, photo)) is not None]
        kept = tuple(thumb for thumb in mine if thumb.photo.kept)
        rejected = tuple(thumb for thumb in mine if not thumb.photo.kept)
        sheets.append(Sheet(blade, side, kept, rejected))
    return sheets


def _thumbnail(folder: Path, photo: PhotoPart) -> Thumbnail | None:
    picture = _read(folder / photo.file)
    if picture is None:
        return None
    scale = min(1.0, THUMBNAIL_PX / picture.shape[1])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return Thumbnail(photo, base64.b64encode(_jpeg(np.asarray(small, np.uint8))).decode())


def _read(path: Path) -> NDArray[np.uint8] | None:
    # The decoder's own reduction is many times quicker than decoding all of a large picture.
    for flag in (cv2.IMREAD_REDUCED_COLOR_4, cv2.IMREAD_COLOR):
        picture = cv2.imread(str(path), flag)
        if picture is None or picture.shape[1] >= THUMBNAIL_PX:
            break
    return None if picture is None else np.asarray(picture, np.uint8)


def _jpeg(picture: NDArray[np.uint8], qualities: Sequence[int] = _QUALITIES) -> bytes:
    data = b""
    for quality in qualities:
        data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
        if len(data) <= MAX_THUMBNAIL_BYTES:
            break
    return data
