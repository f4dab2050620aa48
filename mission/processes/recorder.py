"""The recorder: everything on the bus into the mission folder; photos fetched and judged.

It never holds anything up: the bus hands it copies, and all writing happens in its own threads.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from config.settings import Settings
from config.sources import to_toml
from drivers.autopilot_tap import TAP_FILE, TapListener
from drivers.bus import Bus, Key, Sample
from mission.flight.observation import RequestKind
from mission.processes.flight_journal import FlightJournal
from mission.processes.photo_keeper import Hands, PhotoKeeper, photo_site
from mission.processes.runtime import Runtime, run_process
from mission.records.course import CourseKeeper
from mission.records.earlier_photos import earlier_of
from mission.records.files import CONFIG, EVENTS, LINK, new_recording, write_whole
from mission.records.link_log import LinkLog
from mission.records.pending import read_pending
from mission.records.photo_moment import PhotoHistory
from mission.records.recording import Recording
from mission.records.room import Room, RoomWatch
from mission.records.second_shot import rewrite, superseded
from mission.records.summary import close_folder
from mission.remote.asked_site import asked_settings
from mission.remote.messages import (
    EarlierMessage,
    FlightReport,
    Intent,
    PhotoTakenMessage,
    ReadyMessage,
    RecordedMessage,
)

log = logging.getLogger(__name__)

#: Requests and replies are not part of a flight's record.
_NOT_RECORDED = ("rpc/", "alive")
READY_S = 1.0


@dataclass(slots=True)
class _Open:
    """The mission that is being recorded."""

    intent: Intent
    folder: Path
    recording: Recording
    link: LinkLog
    space: RoomWatch
    journal: FlightJournal
    photos: PhotoKeeper
    history: PhotoHistory
    settings: Settings
    """With what was asked for."""
    course: CourseKeeper = field(default_factory=CourseKeeper)
    unread: set[str] = field(default_factory=set)
    """Keys of messages that could not be read: told once each."""
    event_lines_lost: int = 0
    event_fault: str = ""

    def not_recorded(self) -> tuple[str, ...]:
        """Return what the recordings lack, in words."""
        lines = self.event_lines_lost
        events = (f"{EVENTS} lacks {lines} lines: {self.event_fault}",) if lines else ()
        return (*self.space.words, *self.recording.lost(), *self.link.lost(), *events)


class Recorder:
    """Takes samples from the bus; one mission at a time."""

    def __init__(self, runtime: Runtime, bus: Bus) -> None:
        self._settings = runtime.settings
        self._clock = runtime.clock
        self._bus = bus
        self._tap = TapListener(
            runtime.run_dir / TAP_FILE, runtime.settings.autopilot.system_id, self._take_link
        )
        self._open: _Open | None = None
        # One thread for the files that grow, so that their order is kept; others for photos.
        self._writer = ThreadPoolExecutor(1, "write")
        self._fetchers = ThreadPoolExecutor(2, "photo")

    async def run(self) -> None:
        """Record until cancelled; an open recording is closed."""
        self._bus.subscribe("**", self._take)
        listening = asyncio.create_task(self._tap.run(), name="the vehicle's link")
        try:
            while True:
                folder = "" if self._open is None else str(self._open.folder)
                ready = ReadyMessage(name="recorder", recording=folder)
                self._bus.publish(Key.READY, ready.model_dump_json().encode())
                self._look_at_the_disk()
                await asyncio.sleep(READY_S)
        finally:
            listening.cancel()
            if self._open is not None:
                self._submit(self._open.recording.close)
                self._submit(self._open.link.close)
            self._writer.shutdown(wait=True)
            self._fetchers.shutdown(wait=False, cancel_futures=True)

    def _submit(self, work: Callable[[], None]) -> None:
        def guarded() -> None:
            try:
                work()
            except OSError as error:
                log.error("data lost: %s", error)

        self._writer.submit(guarded)

    def _look_at_the_disk(self) -> None:
        mission, now_s = self._open, self._clock.now_s()
        if mission is not None:
            self._submit(lambda: mission.space.look(now_s))

    def _take_link(self, data: bytes) -> None:
        """Record a datagram of the vehicle's link."""
        mission = self._open
        if mission is not None and mission.space.room > Room.PHOTOS:
            utc_ns = time.time_ns()
            self._submit(lambda: mission.link.add(data, utc_ns))

    def _take(self, sample: Sample) -> None:
        if sample.key == Key.RECORD:
            # Told again: this process came up, or came back, while a mission was under way.
            sample = Sample(Key.INTENT, sample.payload, None)
        if sample.key == Key.INTENT:
            self._take_intent(Intent.model_validate_json(sample.payload))
        mission = self._open
        if mission is None or sample.key.startswith(_NOT_RECORDED):
            return
        if mission.space.room >= (Room.EVERYTHING if sample.key == Key.FRAME else Room.RECORDING):
            stamp_ns, utc_ns = round(self._clock.now_s() * 1e9), time.time_ns()
            self._submit(
                lambda: mission.recording.add(
                    sample.key,
                    sample.payload,
                    stamp_ns,
                    attachment=sample.attachment,
                    utc_ns=utc_ns,
                )
            )
        try:
            mission.history.take(sample.key, sample.payload)
            mission.course.take(sample.key, sample.payload)
        except ValueError as error:  # recorded as it came; a photo's place may be told less well
            if sample.key not in mission.unread:
                log.warning("%s cannot be read: %s", sample.key, error)
            mission.unread.add(sample.key)
        if sample.key == Key.EVENT:
            self._submit(lambda: _append(mission, sample.payload))
        elif sample.key == Key.PHOTO:
            mission.photos.take(PhotoTakenMessage.model_validate_json(sample.payload))
        elif sample.key == Key.JOURNAL:
            self._submit(partial(mission.journal.so_far, _report(sample.payload)))
        elif sample.key == Key.REPORT:
            task = asyncio.create_task(self._end(mission, _report(sample.payload)))
            self._ending = task

    def _take_intent(self, intent: Intent) -> None:
        if intent.kind is not RequestKind.START:
            return
        folder = Path(intent.mission_dir)
        if self._open is not None:
            if (self._open.folder, self._open.intent.flight) == (folder, intent.flight):
                return
            # The flight that was recorded never told its end: its process was lost.
            self._submit(self._open.recording.close)
            self._submit(self._open.link.close)
        settings = asked_settings(self._settings, intent.site, intent)
        asked = settings.inspection.model_copy(
            update={"blades": intent.blades, "sides": intent.sides}
        )
        site = photo_site(settings, intent.site)
        history = PhotoHistory(self._settings.positioning)
        hands = Hands(self._bus, self._settings, self._submit, self._fetchers)
        file = new_recording(folder)
        recording = Recording(file, settings, site.turbine)
        self._open = _Open(
            intent,
            folder,
            recording,
            LinkLog(new_recording(folder, LINK)),
            RoomWatch(folder),
            FlightJournal(folder, intent, file),
            PhotoKeeper(hands, folder, site, history),
            history,
            settings.model_copy(update={"inspection": asked}),
        )
        self._tap.want(True)
        text = to_toml(settings)
        self._submit(lambda: write_whole(folder / CONFIG, text.encode()))
        self._submit(self._open.journal.begin)
        self._looking_back = asyncio.create_task(self._look_back(self._open))

    async def _look_back(self, mission: _Open) -> None:
        """Fetch what a recorder before could not; tell a later flight what there is."""
        loop = asyncio.get_running_loop()
        waiting = await loop.run_in_executor(self._writer, read_pending, mission.folder)
        await mission.photos.take_waiting(waiting)
        if mission.intent.flight == 1:
            return
        numbers = [taken.command.photo_id for taken, _ in waiting]
        # In its turn after what was begun there: the journal has read the earlier flights.
        earlier = await loop.run_in_executor(
            self._writer, earlier_of, mission.journal.before, tuple(mission.photos.records), numbers
        )
        message = EarlierMessage(
            mission_dir=str(mission.folder), flight=mission.intent.flight, earlier=earlier
        )
        self._bus.publish(Key.EARLIER, message.model_dump_json().encode())

    async def _end(self, mission: _Open, report: FlightReport) -> None:
        await mission.photos.all_in()
        if self._open is mission:  # and not the next one, begun while photos came in
            self._open = None
            self._tap.want(False)
        loop = asyncio.get_running_loop()
        ok, text = True, ""
        try:
            await loop.run_in_executor(self._writer, mission.recording.close)
            await loop.run_in_executor(self._writer, mission.link.close)
            report, course, flights = await loop.run_in_executor(
                self._writer, mission.journal.end, report, mission.course.course()
            )
            limit_mm = mission.settings.tracking.max_gsd_mm
            records = superseded(mission.photos.records, limit_mm)
            changed = [one for one in records if one not in mission.photos.records]
            await loop.run_in_executor(self._writer, rewrite, mission.folder, changed)
            await loop.run_in_executor(
                self._writer,
                close_folder,
                mission.folder,
                report,
                records,
                tuple(mission.photos.lost.values()),
                mission.settings,
                course,
                mission.not_recorded(),
                flights,
            )
        except Exception as error:  # whatever it is, those who wait are told
            log.exception("the mission folder is not complete")
            ok, text = False, f"{type(error).__name__}: {error}"
        message = RecordedMessage(mission_dir=str(mission.folder), ok=ok, text=text)
        self._bus.publish(Key.RECORDED, message.model_dump_json().encode())


def _report(payload: bytes) -> FlightReport:
    return FlightReport.model_validate_json(payload)


def _append(mission: _Open, line: bytes) -> None:
    """Append an event; one that finds no room is counted, and the next is tried again."""
    try:
        with (mission.folder / EVENTS).open("ab") as file:
            file.write(line + b"\n")
    except OSError as error:
        mission.event_lines_lost += 1
        mission.event_fault = error.strerror or str(error)


async def record(runtime: Runtime) -> None:
    """Run the recorder until cancelled."""
    with runtime.open_bus() as bus:
        await Recorder(runtime, bus).run()


if __name__ == "__main__":
    run_process("recorder", record, niceness=4)
