"""The recorder: everything on the bus into the mission folder; photos fetched and judged.

It never holds anything up: the bus hands it copies, and all writing happens in its own threads.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from config.sources import to_toml
from drivers.bus import Bus, Key, Sample
from mission.flight.observation import RequestKind
from mission.processes.runtime import Runtime, run_process
from mission.records.files import CONFIG, EVENTS, RECORDING, write_whole
from mission.records.photo_metadata import NotAJpeg, PhotoRecord
from mission.records.photos import PhotoLost, fetch, store
from mission.records.recording import Recording
from mission.records.summary import close_folder
from mission.remote.messages import (
    FlightReport,
    Intent,
    PhotoResultMessage,
    PhotoTakenMessage,
    RecordedMessage,
)

log = logging.getLogger(__name__)

#: Requests and replies are not part of a flight's record.
_NOT_RECORDED = ("rpc/", "alive")
PHOTO_PATIENCE_S = 30.0


@dataclass(slots=True)
class _Open:
    """The mission that is being recorded."""

    intent: Intent
    folder: Path
    recording: Recording
    records: list[PhotoRecord] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    photo_tasks: set[asyncio.Task[None]] = field(default_factory=set)


class Recorder:
    """Takes samples from the bus; one mission at a time."""

    def __init__(self, runtime: Runtime, bus: Bus) -> None:
        self._settings = runtime.settings
        self._clock = runtime.clock
        self._bus = bus
        self._open: _Open | None = None
        # One thread for the files that grow, so that their order is kept; others for photos.
        self._writer = ThreadPoolExecutor(1, "write")
        self._fetchers = ThreadPoolExecutor(2, "photo")

    async def run(self) -> None:
        """Record until cancelled; an open recording is closed."""
        self._bus.subscribe("**", self._take)
        try:
            await asyncio.Event().wait()
        finally:
            if self._open is not None:
                self._submit(self._open.recording.close)
            self._writer.shutdown(wait=True)
            self._fetchers.shutdown(wait=False, cancel_futures=True)

    def _submit(self, work: Callable[[], None]) -> None:
        def guarded() -> None:
            try:
                work()
            except OSError as error:
                log.error("data lost: %s", error)

        self._writer.submit(guarded)

    def _take(self, sample: Sample) -> None:
        if sample.key == Key.INTENT:
            self._take_intent(Intent.model_validate_json(sample.payload))
        mission = self._open
        if mission is None or sample.key.startswith(_NOT_RECORDED):
            return
        stamp_ns = round(self._clock.now_s() * 1e9)
        self._submit(lambda: mission.recording.add(sample.key, sample.payload, stamp_ns))
        if sample.key == Key.EVENT:
            path = mission.folder / EVENTS
            self._submit(lambda: _append(path, sample.payload))
        elif sample.key == Key.PHOTO:
            taken = PhotoTakenMessage.model_validate_json(sample.payload)
            task = asyncio.create_task(self._take_photo(mission, taken))
            mission.photo_tasks.add(task)
            task.add_done_callback(mission.photo_tasks.discard)
        elif sample.key == Key.REPORT:
            report = FlightReport.model_validate_json(sample.payload)
            task = asyncio.create_task(self._end(mission, report))
            self._ending = task

    def _take_intent(self, intent: Intent) -> None:
        if intent.kind is not RequestKind.START:
            return
        folder = Path(intent.mission_dir)
        recording = Recording(folder / RECORDING)
        self._open = _Open(intent, folder, recording)
        text = to_toml(self._settings)
        self._submit(lambda: write_whole(folder / CONFIG, text.encode()))

    async def _take_photo(self, mission: _Open, taken: PhotoTakenMessage) -> None:
        loop = asyncio.get_running_loop()
        site = mission.intent.site
        try:
            jpeg = await loop.run_in_executor(self._fetchers, fetch, taken.url)
            photo = await loop.run_in_executor(
                self._fetchers, store, jpeg, taken, site, self._settings, mission.folder
            )
        except (PhotoLost, NotAJpeg, OSError) as error:
            log.error("photo %d lost: %s", taken.command.photo_id, error)
            mission.lost.append(f"photo {taken.command.photo_id}: {error}")
            self._tell(taken.command.photo_id, kept=False, reason=str(error))
            return
        mission.records.append(photo.record)
        self._tell(taken.command.photo_id, kept=photo.record.kept, reason=photo.record.reason)

    def _tell(self, photo_id: int, *, kept: bool, reason: str) -> None:
        result = PhotoResultMessage(photo_id=photo_id, kept=kept, reason=reason)
        self._bus.publish(Key.PHOTO_RESULT, result.model_dump_json().encode())

    async def _end(self, mission: _Open, report: FlightReport) -> None:
        if mission.photo_tasks:
            await asyncio.wait(mission.photo_tasks, timeout=PHOTO_PATIENCE_S)
        self._open = None
        loop = asyncio.get_running_loop()
        ok, text = True, ""
        try:
            await loop.run_in_executor(self._writer, mission.recording.close)
            await loop.run_in_executor(
                self._writer,
                close_folder,
                mission.folder,
                report,
                tuple(mission.records),
                tuple(mission.lost),
                self._settings,
            )
        except Exception as error:  # whatever it is, those who wait are told
            log.exception("the mission folder is not complete")
            ok, text = False, f"{type(error).__name__}: {error}"
        message = RecordedMessage(mission_dir=str(mission.folder), ok=ok, text=text)
        self._bus.publish(Key.RECORDED, message.model_dump_json().encode())


def _append(path: Path, line: bytes) -> None:
    with path.open("ab") as file:
        file.write(line + b"\n")


async def record(runtime: Runtime) -> None:
    """Run the recorder until cancelled."""
    with runtime.open_bus() as bus:
        await Recorder(runtime, bus).run()


if __name__ == "__main__":
    run_process("recorder", record, niceness=4)
