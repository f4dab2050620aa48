"""What stands on a mission's report beside what was measured: who, with what, in which weather."""

from __future__ import annotations

from typing import Annotated
from zoneinfo import available_timezones

from pydantic import AfterValidator

from config.model import ConfigModel


def _a_zone(name: str) -> str:
    if name != "UTC" and name not in available_timezones():
        raise ValueError(f"{name!r} is no time zone: write it like Europe/Berlin or UTC")
    return name


class Report(ConfigModel):
    """Texts of the report; what is empty is left out."""

    title: str = "Blade inspection"
    company: str = ""
    """Who inspects."""
    logo: str = ""
    """Path of a PNG, JPEG or SVG picture, shown at the top."""
    customer: str = ""
    pilot: str = ""
    drone: str = ""
    """Maker, model and serial number."""
    lens: str = ""
    """Where it is more than a focal length."""
    time_zone: Annotated[str, AfterValidator(_a_zone)] = "UTC"
    """IANA name of the zone that times are given in."""
    weather: str = ""
    """As observed on site; the wind that the autopilot estimated is stated beside it."""
    weather_source: str = ""
    remarks: str = ""
    """A paragraph after the summary."""
    closing: str = ""
    """A paragraph at the end: who may rely on what."""
    templates: str = ""
    """Folder with templates of one's own; `report.html.j2`, `report.css` and its parts are looked
    for there first."""
