"""The recorder's journal of a flight: begun, kept up to date, ended; and what came before it."""

from __future__ import annotations

from pathlib import Path

from drivers.bus import Key
from mission.records.course import Course, course_of
from mission.records.files import RECORDING
from mission.records.flights import (
    FlightRecord,
    read_flights,
    whole_course,
    whole_report,
    write_flight,
)
from mission.remote.messages import FlightReport, Intent
from mission.replay.recorded import NotARecording, RecordedMission

_COURSE_KEYS = frozenset({str(Key.STATE), str(Key.VEHICLE)})


class FlightJournal:
    """One flight of a mission folder. Its methods do I/O: call them from the recorder's writer."""

    def __init__(self, folder: Path, intent: Intent, recording: Path) -> None:
        """``recording``: file that this flight is recorded in."""
        self._folder = folder
        self._recording = recording
        self._record = FlightRecord(number=intent.flight, intent=intent, recording=recording.name)
        self._before: list[FlightRecord] = []

    def begin(self) -> None:
        """Write down that a flight was asked for."""
        number = self._record.number
        self._before = [one for one in read_flights(self._folder) if one.number < number]
        write_flight(self._folder, self._record)

    @property
    def before(self) -> tuple[FlightRecord, ...]:
        """The earlier flights of the same inspection."""
        return tuple(self._before)

    def so_far(self, report: FlightReport) -> None:
        """Keep how the flight stands."""
        self._record = self._record.model_copy(update={"report": report})
        write_flight(self._folder, self._record)

    def end(
        self, report: FlightReport, course: Course
    ) -> tuple[FlightReport, Course, tuple[FlightRecord, ...]]:
        """Keep how the flight ended; return report and course of all flights, and these."""
        update = {"report": report, "ended": True, "course": course}
        self._record = self._record.model_copy(update=update)
        write_flight(self._folder, self._record)
        flights = (*self._before, self._record)
        if not self._before:
            return report, course, flights
        courses = [one.course or self._recorded_course(one) for one in self._before]
        return whole_report(flights), whole_course(flights, [*courses, course]), flights

    def _recorded_course(self, flight: FlightRecord) -> Course | None:
        """Return the course of a flight that was broken off, from its recording."""
        try:
            recorded = RecordedMission(self._folder / (flight.recording or RECORDING))
            messages = recorded.messages(_COURSE_KEYS)
            return course_of((message.key, message.payload) for message in messages)
        except (NotARecording, OSError):
            return None
