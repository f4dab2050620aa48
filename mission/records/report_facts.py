"""The head of the report: who, what, when, with what, in which weather; and the settings."""

from __future__ import annotations

import base64
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from zoneinfo import ZoneInfo

from pydantic import ValidationError

from config.recorded import recorded_settings
from config.report import Report
from config.settings import Settings
from mission.records.files import CONFIG
from mission.records.mission_file import MissionFile
from mission.records.report_course import clock

_LOGO_KINDS = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg", ".svg": "svg+xml"}
MAX_LOGO_BYTES = 500_000


class BadLogo(ValueError):
    """The logo cannot be shown."""


@dataclass(frozen=True, slots=True)
class Fact:
    """A line of the head."""

    name: str
    words: str


@dataclass(frozen=True, slots=True)
class Changed:
    """A setting that was not the default."""

    key: str
    value: str
    default: str


def facts(mission: MissionFile) -> list[Fact]:
    """Return what is known of the inspection; what nobody told is left out."""
    told = mission.inspection
    serials = ", ".join(f"{name} {serial}" for name, serial in sorted(told.blade_serials.items()))
    camera = ", ".join(filter(None, (told.camera, told.picture)))
    rotor = mission.rotor
    lines = (
        ("Site", mission.site),
        ("Turbine", mission.turbine),
        ("Blades", serials or "serial numbers not given"),
        ("Date", f"{local(mission.started_utc, told.time_zone)}, {clock(mission.duration_s)} min"),
        ("Flights", flights(mission)),
        ("Customer", told.customer),
        ("Inspected by", told.company),
        ("Operator", mission.operator),
        ("Pilot", told.pilot),
        ("Drone", ", ".join(filter(None, (told.drone, mission.vehicle)))),
        ("Camera", camera),
        ("Lens", told.lens),
        ("Weather", weather(mission)),
        (
            "Rotor",
            "braked and locked, yaw off: confirmed by the operator"
            if mission.rotor_locked
            else "lock not confirmed",
        ),
        (
            "Reference",
            ""
            if rotor is None
            else f"metres from each blade's root flange; angles from the {rotor.reference}",
        ),
    )
    return [Fact(name, words) for name, words in lines if words]


def flights(mission: MissionFile) -> str:
    """Return how many flights it took and how each ended; empty for one."""
    if len(mission.flights) < 2:
        return ""
    swaps = f"{mission.swaps} battery swap{'' if mission.swaps == 1 else 's'}"
    each = "; ".join(
        f"{one.number}: {one.duration_s / 60:.1f} min, {one.words or one.state}"
        for one in mission.flights
    )
    return f"{len(mission.flights)} flights, {swaps} ({each})"


def weather(mission: MissionFile) -> str:
    """Return the weather as it was told and measured, each with its source."""
    told, course = mission.inspection, mission.course
    parts = []
    if told.weather:
        parts.append(f"{told.weather} ({told.weather_source or 'as told'})")
    if course is not None and course.wind_mean_mps is not None:
        parts.append(
            f"wind {course.wind_mean_mps:.1f} m/s from {course.wind_from_deg or 0:.0f}°, at most "
            f"{course.wind_max_mps or 0:.1f} m/s (estimated by the autopilot in flight)"
        )
    return "; ".join(parts) or "not recorded"


def local(moment: datetime, zone: str) -> str:
    """Return a moment as written in a time zone, with the zone's name and offset."""
    there = moment.astimezone(ZoneInfo(zone))
    offset = there.strftime("%z")
    name = "UTC" if zone == "UTC" else f"{zone} (UTC{offset[:3]}:{offset[3:]})"
    return f"{there.day} {there.strftime('%B %Y, %H:%M')} {name}"


def told_in(folder: Path) -> Report:
    """Return the report's settings that a mission was flown with; defaults where none are told."""
    try:
        table = tomllib.loads((folder / CONFIG).read_text()).get("report", {})
        return Report.model_validate(table)
    except (OSError, ValueError):
        return Report()


def logo_data(path: str) -> str:
    """Return a picture as a data URL; empty for no path. Raises `BadLogo`."""
    if not path:
        return ""
    kind = _LOGO_KINDS.get(Path(path).suffix.lower())
    if kind is None:
        raise BadLogo(f"{path}: a logo is a PNG, JPEG or SVG file")
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise BadLogo(f"{path}: {error.strerror}") from error
    if len(data) > MAX_LOGO_BYTES:
        raise BadLogo(f"{path} has {len(data)} bytes: a logo has at most {MAX_LOGO_BYTES}")
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def changed_settings(folder: Path) -> list[Changed]:
    """Return the settings of the mission's config.toml that differ from the defaults."""
    try:
        flown, _ = recorded_settings(tomllib.loads((folder / CONFIG).read_text()))
    except (OSError, ValueError, ValidationError):
        return []
    defaults = dict(_leaves(Settings().model_dump(mode="json")))
    return [
        Changed(key, _words(value), _words(defaults.get(key)))
        for key, value in _leaves(flown.model_dump(mode="json"))
        if value != defaults.get(key) and not key.startswith(("sites", "report."))
    ]


def _leaves(table: Mapping[str, object], before: str = "") -> Iterator[tuple[str, object]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def _words(value: object) -> str:
    return "not set" if value is None else str(value)
