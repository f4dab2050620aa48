"""The report: one self-contained HTML page of a mission folder."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import cv2
import numpy as np
from jinja2 import (
    ChoiceLoader,
    Environment,
    FileSystemLoader,
    PackageLoader,
    StrictUndefined,
    TemplateError,
    select_autoescape,
)
from numpy.typing import NDArray
from pydantic import ValidationError

from config.report import Report
from mission.records.course import Course, course_of
from mission.records.files import EVENTS, REPORT, write_whole
from mission.records.findings import Finding
from mission.records.mission_file import (
    InspectionPart,
    MissionFile,
    NotAMission,
    PhotoPart,
    read_mission,
)
from mission.records.not_inspected import not_asked, not_inspected, skins_of
from mission.records.photo_record import NotARecord, read_record, stored_records
from mission.records.report_blade_map import side_maps, skin_seen
from mission.records.report_course import bar, clock, happenings, labelled, plots
from mission.records.report_facts import changed_settings, facts, local, logo_data, told_in
from mission.records.report_rotor import rotor_picture
from mission.records.report_tones import ENTROPY, MEAN, SIGMA, curves, height
from mission.records.tones import Tones, tones_of
from mission.remote.messages import EventMessage

__all__ = ["BadTemplate", "NotAMission", "write_report"]

THUMBNAIL_PX = 320
#: A page of 300 photos stays below 15 MB.
MAX_THUMBNAIL_BYTES = 30_000
_QUALITIES = (72, 50, 30, 10)
_NO_VALUE = "–"
_COURSE_KEYS = frozenset({"mission/state", "vehicle/state"})


class BadTemplate(ValueError):
    """A template of one's own cannot be used."""


@dataclass(frozen=True, slots=True)
class Thumbnail:
    """One photo of the contact sheet."""

    photo: PhotoPart
    data: str
    """JPEG, base64."""
    tones: Tones | None


@dataclass(frozen=True, slots=True)
class Sheet:
    """The photos of one side, root first; rejected ones by themselves."""

    blade: str
    side: str
    kept: tuple[Thumbnail, ...]
    rejected: tuple[Thumbnail, ...]


def write_report(
    folder: Path,
    findings: Sequence[Finding] = (),
    told: Mapping[str, object] | None = None,
) -> Path:
    """Render `report.html` of a mission folder and return its path.

    ``told``: fields of `config.report.Report` told since the flight; they win over those it was
    flown with. Raises `NotAMission`, `BadTemplate` or `report_facts.BadLogo`.
    """
    settings = told_in(folder).model_copy(update=dict(told or {}))
    mission = _told(read_mission(folder), folder, dict(told or {}))
    events = _events(folder / EVENTS)
    sheets = _sheets(folder, mission)
    skins = skins_of(mission, stored_records(folder))
    tones = {
        one.photo.file: one.tones for sheet in sheets for one in sheet.kept if one.tones is not None
    }
    page = render(
        settings,
        "report.html.j2",
        mission=mission,
        begin_s=mission.begin_s,
        logo=logo_data(settings.logo),
        facts=facts(mission),
        rotor_picture=rotor_picture(mission),
        maps=side_maps(mission, skins, findings),
        skin_seen=skin_seen(mission, skins),
        missing=not_inspected(mission, skins),
        not_asked=not_asked(mission),
        curves=curves(mission, tones),
        bands={"mean": MEAN, "sigma": SIGMA, "entropy": ENTROPY},
        bar=bar(mission, events),
        plots=plots(mission),
        happenings=happenings(events),
        events=events,
        findings=tuple(findings),
        changed=changed_settings(folder),
        sheets=sheets,
    )
    report = folder / REPORT
    write_whole(report, page.encode())
    return report


def _told(mission: MissionFile, folder: Path, told: dict[str, object]) -> MissionFile:
    """Return the mission with what was told since, and its course where an older one has none."""
    changes: dict[str, object] = {}
    known = {key: value for key, value in told.items() if key in InspectionPart.model_fields}
    if known:
        changes["inspection"] = mission.inspection.model_copy(update=known)
    if mission.course is None and (course := _recorded_course(folder)) is not None:
        changes["course"] = course
    return mission.model_copy(update=changes) if changes else mission


def _recorded_course(folder: Path) -> Course | None:
    from mission.replay.recorded import NotARecording, RecordedMission

    try:
        messages = RecordedMission(folder).messages(_COURSE_KEYS)
        return course_of((message.key, message.payload) for message in messages)
    except NotARecording:
        return None


def render(settings: Report, template: str, **values: object) -> str:
    """Return a page by a template of one's own, or the shipped one. Raises `BadTemplate`."""
    environment = _environment(settings.templates)
    try:
        return environment.get_template(template).render(values)
    except TemplateError as error:
        if not settings.templates:
            raise
        raise BadTemplate(f"{settings.templates}: {error}") from error


def _environment(own: str = "") -> Environment:
    shipped = PackageLoader("mission.records")
    environment = Environment(
        loader=ChoiceLoader([FileSystemLoader(own), shipped]) if own else shipped,
        autoescape=select_autoescape(default=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["num"] = _number
    environment.filters["clock"] = clock
    environment.filters["labelled"] = labelled
    environment.filters["local"] = local
    environment.filters["height"] = height
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


def thumbnail_data(path: Path, width_px: int, most_bytes: int) -> str:
    """Return a photo reduced to a width, as base64 of a JPEG; empty where it cannot be read."""
    picture = read_picture(path, width_px)
    if picture is None:
        return ""
    return _base64(picture, width_px, most_bytes)


def picture_data(picture: NDArray[np.uint8], most_bytes: int) -> str:
    """Return a picture as base64 of a JPEG."""
    return base64.b64encode(_jpeg(picture, most_bytes)).decode()


def _base64(picture: NDArray[np.uint8], width_px: int, most_bytes: int) -> str:
    scale = min(1.0, width_px / picture.shape[1])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return picture_data(np.asarray(small, np.uint8), most_bytes)


def _thumbnail(folder: Path, photo: PhotoPart) -> Thumbnail | None:
    picture = read_picture(folder / photo.file)
    if picture is None:
        return None
    data = _base64(picture, THUMBNAIL_PX, MAX_THUMBNAIL_BYTES)
    return Thumbnail(photo, data, _tones(folder / photo.file, picture) if photo.kept else None)


def _tones(path: Path, picture: NDArray[np.uint8]) -> Tones | None:
    try:
        record = read_record(path)
    except NotARecord:
        return None
    return tones_of(picture, record.view, record.width_px)


def read_picture(path: Path, width_px: int = THUMBNAIL_PX) -> NDArray[np.uint8] | None:
    """Return a photo at least as wide as that where it is, else as it is; None: unreadable."""
    # The decoder's own reduction is many times quicker than decoding all of a large picture.
    for flag in (cv2.IMREAD_REDUCED_COLOR_4, cv2.IMREAD_COLOR):
        picture = cv2.imread(str(path), flag)
        if picture is None or picture.shape[1] >= width_px:
            break
    return None if picture is None else np.asarray(picture, np.uint8)


def _jpeg(picture: NDArray[np.uint8], most_bytes: int = MAX_THUMBNAIL_BYTES) -> bytes:
    data = b""
    for quality in _QUALITIES:
        data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
        if len(data) <= most_bytes:
            break
    return data
