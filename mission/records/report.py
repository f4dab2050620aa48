"""The report: one self-contained HTML page of a mission folder."""

from __future__ import annotations

import base64
import json
import math
from dataclasses import dataclass
from pathlib import Path

import cv2
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from mission.records.files import EVENTS, MISSION, REPORT, write_whole

THUMBNAIL_PX = 220
THUMBNAIL_QUALITY = 62
_TOP_EVENTS = 200


class NotAMission(ValueError):
    """The folder holds no mission."""


@dataclass(frozen=True, slots=True)
class _Arm:
    """One blade of the rotor picture, in SVG coordinates seen from upwind."""

    name: str
    x: float
    y: float
    label_x: float
    label_y: float


@dataclass(frozen=True, slots=True)
class _Thumbnail:
    href: str
    data: str
    caption: str
    kept: bool
    title: str


@dataclass(frozen=True, slots=True)
class _Strip:
    """One pass on the blade map: photographed metres as spans in percent of its length."""

    blade: str
    side: str
    spans: tuple[tuple[float, float], ...]
    unseen: tuple[tuple[float, float, str], ...]
    coverage: float
    photos: int


def write_report(folder: Path) -> Path:
    """Render `report.html` of a mission folder and return its path. Raises `NotAMission`."""
    path = folder / MISSION
    try:
        mission = json.loads(path.read_text())
    except FileNotFoundError as error:
        raise NotAMission(f"{folder} holds no {MISSION}") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise NotAMission(f"{path} is not JSON: {error}") from error
    environment = Environment(
        loader=PackageLoader("mission.records"),
        autoescape=select_autoescape(default=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template("report.html.j2").render(
        mission=mission,
        arms=_arms(mission),
        strips=_strips(mission),
        thumbnails=_thumbnails(folder, mission),
        events=_events(folder),
        exposure=_exposure_curves(mission),
    )
    report = folder / REPORT
    write_whole(report, page.encode())
    return report


def _arms(mission: dict[str, object]) -> list[_Arm]:
    rotor = mission.get("rotor")
    if not isinstance(rotor, dict):
        return []
    arms = []
    for blade in rotor["blades"]:
        angle = math.radians(blade["angle_deg"])
        # From straight down, counter-clockwise seen from the front: towards the viewer's right.
        x, y = math.sin(angle), math.cos(angle)
        arms.append(_Arm(blade["name"], 100 * x, 100 * y, 116 * x, 116 * y + 4))
    return arms


def _strips(mission: dict[str, object]) -> list[_Strip]:
    passes = mission.get("passes")
    strips = []
    for one in passes if isinstance(passes, list) else []:
        length = max(one["length_m"], 1e-6)
        spans = tuple(
            (100 * start / length, 100 * (stop - start) / length)
            for start, stop in one["photographed_m"]
        )
        unseen = tuple(
            (
                100 * gap["from_m"] / length,
                100 * (gap["to_m"] - gap["from_m"]) / length,
                gap["reason"],
            )
            for gap in one["unseen"]
        )
        strips.append(
            _Strip(one["blade"], one["side"], spans, unseen, one["coverage"], one["photos"])
        )
    return strips


def _thumbnails(folder: Path, mission: dict[str, object]) -> list[_Thumbnail]:
    photos = mission.get("photo_list")
    thumbnails = []
    for photo in photos if isinstance(photos, list) else []:
        picture = cv2.imread(str(folder / photo["file"]), cv2.IMREAD_COLOR)
        if picture is None:
            continue
        scale = THUMBNAIL_PX / picture.shape[1]
        small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        _, jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, THUMBNAIL_QUALITY])
        grey = photo["mean_grey"]
        thumbnails.append(
            _Thumbnail(
                href=photo["file"],
                data=base64.b64encode(jpeg.tobytes()).decode(),
                caption=f"{photo['blade']} {photo['side']} {photo['metre']:.1f} m",
                kept=photo["kept"],
                title=photo["reason"] or (f"mean grey {grey:.0f}" if grey is not None else ""),
            )
        )
    return thumbnails


def _events(folder: Path) -> list[dict[str, object]]:
    path = folder / EVENTS
    if not path.exists():
        return []
    lines = path.read_text(errors="replace").splitlines()
    events: list[dict[str, object]] = [json.loads(line) for line in lines if line.strip()]
    return events[:_TOP_EVENTS]


@dataclass(frozen=True, slots=True)
class _Curve:
    blade: str
    side: str
    points: str
    """SVG polyline of mean grey (0-255, upwards) over the metre."""


def _exposure_curves(mission: dict[str, object]) -> list[_Curve]:
    photos = mission.get("photo_list")
    groups: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for photo in photos if isinstance(photos, list) else []:
        if photo["mean_grey"] is not None and photo["kept"]:
            group = groups.setdefault((photo["blade"], photo["side"]), [])
            group.append((photo["metre"], photo["mean_grey"]))
    curves = []
    for (blade, side), values in sorted(groups.items()):
        length = max(max(metre for metre, _ in values), 1.0)
        points = " ".join(
            f"{300 * metre / length:.1f},{100 - grey / 2.55:.1f}" for metre, grey in sorted(values)
        )
        curves.append(_Curve(blade, side, points))
    return curves
