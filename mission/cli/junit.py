"""Simulated missions as a JUnit report, which CI services read."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mission.cli.exits import Exit

#: Figures of mission.json that stand as properties of a case, by their path.
FIGURES = (
    ("rotor", "stop_angle_deg"),
    ("errors", "stop_angle_deg"),
    ("truth", "min_clearance_m"),
    ("photos", "kept"),
    ("timing", "real_time_factor"),
    ("duration_s",),
)


@dataclass(frozen=True, slots=True)
class Flown:
    """One scenario that was flown, or could not be."""

    scenario: str
    code: Exit
    words: str
    """How it ended, in a sentence."""
    wall_s: float
    folder: Path | None
    mission: Mapping[str, object]
    """mission.json; empty where there is none."""


def write_junit(path: Path, flown: Sequence[Flown]) -> None:
    """Write the report: a case a scenario; one that did not complete is a failure."""
    suite = ET.Element(
        "testsuite",
        name="bladescout",
        tests=str(len(flown)),
        failures=str(sum(one.code not in (Exit.DONE, Exit.DEVICE) for one in flown)),
        errors=str(sum(one.code is Exit.DEVICE for one in flown)),
        time=f"{sum(one.wall_s for one in flown):.1f}",
    )
    for one in flown:
        suite.append(_case(one))
    path.parent.mkdir(parents=True, exist_ok=True)
    ET.ElementTree(suite).write(path, encoding="utf-8", xml_declaration=True)


def _case(one: Flown) -> ET.Element:
    name = Path(one.scenario).stem
    case = ET.Element(
        "testcase", classname="bladescout.simulate", name=name, time=f"{one.wall_s:.1f}"
    )
    properties = ET.SubElement(case, "properties")
    for figure in FIGURES:
        value = _at(one.mission, figure)
        if value is not None:
            ET.SubElement(properties, "property", name=".".join(figure), value=str(value))
    if one.code is Exit.DEVICE:
        ET.SubElement(case, "error", message=one.words)
    elif one.code is not Exit.DONE:
        ET.SubElement(case, "failure", type=one.code.name.lower(), message=one.words)
    if one.folder is not None:
        ET.SubElement(case, "system-out").text = f"{one.folder}/report.html"
    return case


def _at(mission: Mapping[str, object], figure: tuple[str, ...]) -> object:
    value: object = mission
    for name in figure:
        value = value.get(name) if isinstance(value, Mapping) else None
    return value
