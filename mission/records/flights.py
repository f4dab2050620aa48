"""The flights of an inspection: a journal of each in its folder, and all of them as one.

`flights/<number>.json` is written when a flight begins, every few seconds while it lasts, and at
its end: what a process that was killed can no longer tell stands there.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from mission.flight.command import MissionState, Phase
from mission.flight.events import EventRecord
from mission.flight.report import MissionReport, PassReport, PhaseTime
from mission.records.course import Course
from mission.records.files import write_whole
from mission.remote.messages import FlightReport, Intent

log = logging.getLogger(__name__)

FLIGHTS = "flights"
BROKEN_OFF = "broken off: the process that flew it was lost"
#: Between two flights on one axis of time, where the clock began anew in between.
APART_S = 60.0


class FlightRecord(BaseModel):
    """One flight, as far as it is known."""

    model_config = ConfigDict(frozen=True, extra="ignore", ser_json_inf_nan="strings")
    schema_version: int = 1
    number: int
    intent: Intent
    report: FlightReport | None = None
    """The newest; None: it had not taken off yet."""
    ended: bool = False
    """The flight itself told how it ended."""
    course: Course | None = None
    recording: str = ""
    """Name of the file in the mission folder that holds it."""

    @property
    def state(self) -> MissionState | None:
        """How the flight ended; None: it never told."""
        return self.report.report.state if self.report is not None and self.ended else None


def write_flight(folder: Path, record: FlightRecord) -> None:
    """Write the journal of a flight."""
    write_whole(_file(folder, record.number), record.model_dump_json(indent=1).encode())


def read_flights(folder: Path) -> list[FlightRecord]:
    """Return the flights of a mission folder by number; what cannot be read is left out."""
    found = []
    for file in (folder / FLIGHTS).glob("*.json"):
        try:
            found.append(FlightRecord.model_validate_json(file.read_bytes()))
        except (OSError, ValidationError) as error:
            log.warning("%s is no flight's journal: %s", file, error)
    return sorted(found, key=lambda record: record.number)


def last_number(folder: Path) -> int:
    """Return the number of the last flight; 0 where none has begun."""
    names = [file.stem for file in (folder / FLIGHTS).glob("*.json")]
    return max((int(name) for name in names if name.isdecimal()), default=0)


def _file(folder: Path, number: int) -> Path:
    return folder / FLIGHTS / f"{number}.json"


# --- all flights as one -------------------------------------------------------------------------


def offsets_s(records: Sequence[FlightRecord]) -> list[float]:
    """Return what is added to each flight's times, so that they follow each other.

    0 while one clock went on; a companion computer that was switched off counts from 0 again.
    """
    offsets, end_s = [], -math.inf
    for record in records:
        phases = () if record.report is None else record.report.report.phases
        begin_s = end_s if record.report is None else _begun_s(record.report)
        offset = 0.0 if begin_s >= end_s or not phases else end_s + APART_S - begin_s
        offsets.append(offset)
        if phases:
            end_s = phases[-1].to_s + offset
    return offsets


def whole_report(records: Sequence[FlightRecord]) -> FlightReport:
    """Return the report of all flights: the last one's, with what the others add.

    The rotor is the first one's that was measured: it gave the blades their names. Hub and tower
    are told in that flight's own frame.
    """
    flown = [(record, record.report) for record in records]
    reports = [report for _, report in flown if report is not None]
    last = reports[-1]
    first = next((one for one in reports if one.report.rotor is not None), last)
    offsets = offsets_s(records)
    phases: list[PhaseTime] = []
    events: list[EventRecord] = []
    for (_, report), offset in zip(flown, offsets, strict=True):
        if report is None:
            continue
        for one in report.report.phases:
            if one.phase is not Phase.IDLE or not phases:
                phases.append(PhaseTime(one.phase, one.from_s + offset, one.to_s + offset))
        events += [replace(event, t_s=event.t_s + offset) for event in report.report.events]
    whole = replace(
        last.report,
        rotor=first.report.rotor,
        duration_s=sum(one.report.duration_s for one in reports),
        iterations=sum(one.report.iterations for one in reports),
        phases=tuple(phases),
        events=tuple(events),
        passes=_passes([one.report for one in reports]),
    )
    return last.model_copy(
        update={
            "report": whole,
            "tower_foot_w": first.tower_foot_w,
            "started_utc": reports[0].started_utc,
            "frames": sum(one.frames for one in reports),
            "frames_out_of_range": sum(one.frames_out_of_range for one in reports),
        }
    )


def _passes(reports: Sequence[MissionReport]) -> tuple[PassReport, ...]:
    """Return the sides: photos and coverage as the last flight's books have them.

    Distance and clearance are of what each flight itself flew.
    """
    newest: dict[tuple[str, str], PassReport] = {}
    for report in reports:
        for one in report.passes:
            before = newest.get((one.blade, one.side))
            newest[one.blade, one.side] = one if before is None else _joined(before, one)
    return tuple(newest.values())


def _joined(before: PassReport, after: PassReport) -> PassReport:
    new = max(0, after.photos - before.photos)
    weights = (before.photos, new)
    return replace(
        after,
        distance_mean_m=_mean((before.distance_mean_m, after.distance_mean_m), weights),
        distance_rms_error_m=_rms(
            (before.distance_rms_error_m, after.distance_rms_error_m), weights
        ),
        distance_min_m=_least(before.distance_min_m, after.distance_min_m),
        clearance_min_m=_least(before.clearance_min_m, after.clearance_min_m),
    )


def _mean(values: Sequence[float | None], weights: Sequence[float]) -> float | None:
    pairs = [(v, max(w, 1)) for v, w in zip(values, weights, strict=True) if v is not None]
    return sum(v * w for v, w in pairs) / sum(w for _, w in pairs) if pairs else None


def _rms(values: Sequence[float | None], weights: Sequence[float]) -> float | None:
    square = _mean([None if v is None else v**2 for v in values], weights)
    return None if square is None else math.sqrt(square)


def _least(*values: float | None) -> float | None:
    return min((value for value in values if value is not None), default=None)


def whole_course(records: Sequence[FlightRecord], courses: Sequence[Course | None]) -> Course:
    """Return the courses of all flights on one axis of time; ``courses`` as ``records``."""
    columns: dict[str, list[object]] = {
        name: [] for name in ("mission_s", "phase", "leg", "distance_m", "clearance_m",
                              "height_m", "battery")
    }  # fmt: skip
    newest = Course()
    for course, offset in zip(courses, offsets_s(records), strict=True):
        if course is None or not course.mission_s:
            continue
        newest = course
        columns["mission_s"] += [round(at + offset, 2) for at in course.mission_s]
        for name in list(columns)[1:]:
            columns[name] += getattr(course, name)
    winds = {name: getattr(newest, name) for name in
             ("wind_mean_mps", "wind_max_mps", "wind_from_deg")}  # fmt: skip
    return Course.model_validate({**columns, **winds})


def told(records: Sequence[FlightRecord]) -> list[dict[str, object]]:
    """Return a line a flight for mission.json."""
    lines: list[dict[str, object]] = []
    for record, offset in zip(records, offsets_s(records), strict=True):
        report = record.report
        words = BROKEN_OFF if report is None or record.state is None else report.report.words
        lines.append(
            {
                "number": record.number,
                "operator": record.intent.operator,
                "started_utc": None if report is None else report.started_utc,
                "begun_s": None if report is None else _begun_s(report) + offset,
                "duration_s": 0.0 if report is None else report.report.duration_s,
                "state": record.state or "broken_off",
                "words": words,
                "swap": bool(report and report.report.swap),
                "offset_s": offset,
            }
        )
    return lines


def _begun_s(report: FlightReport) -> float:
    phases = report.report.phases
    return phases[0].to_s if phases else 0.0


def swaps(records: Sequence[FlightRecord]) -> int:
    """Return how often an inspection went on with a fresh battery because the last was used up."""
    return sum(bool(one.report and one.report.report.swap) for one in records[:-1])
