"""A mission's photos in the recorder: fetched from the camera, judged, stored and told about.

A photo waits in the mission's folder by name until it is stored, so that a recorder that comes
back, or one of a later flight, asks for it again.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from config.errors import ConfigError
from config.presets import load_turbine
from config.settings import Settings
from drivers.bus import Bus, Key
from mission.records.pending import note_pending, strike_out
from mission.records.photo_moment import PhotoHistory, PhotoMoment
from mission.records.photo_record import PhotoRecord, stored_records
from mission.records.photos import NotAJpeg, PhotoLost, PhotoSite, fetch, store
from mission.records.second_shot import asks_again
from mission.remote.messages import PhotoResultMessage, PhotoTakenMessage
from perception.geometry import vec3

log = logging.getLogger(__name__)

PHOTO_PATIENCE_S = 30.0


@dataclass(frozen=True, slots=True)
class Hands:
    """What a keeper works with; the recorder's own."""

    bus: Bus
    settings: Settings
    submit: Callable[[Callable[[], None]], None]
    """Has a file written in its turn."""
    fetchers: ThreadPoolExecutor


class PhotoKeeper:
    """The photos of one mission."""

    def __init__(self, hands: Hands, folder: Path, site: PhotoSite, history: PhotoHistory) -> None:
        self._hands = hands
        self._folder = folder
        self._site = site
        self._history = history
        self.records: list[PhotoRecord] = stored_records(folder)
        """Of the photos that are stored, rejected ones too."""
        self.lost: dict[int, str] = {}
        """In words, by number."""
        self._missing: dict[int, PhotoTakenMessage] = {}
        """The camera did not give these out when asked: asked for once more at the end."""
        self._seen_before: dict[str, int] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._again = 0
        """Photos that are kept and were asked for once more."""

    def take(self, taken: PhotoTakenMessage) -> None:
        """A photo exists at the camera: fetch it, by and by."""
        task = asyncio.create_task(self._take(taken))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def take_waiting(
        self, waiting: Sequence[tuple[PhotoTakenMessage, PhotoMoment | None]]
    ) -> None:
        """Fetch what a recorder before could not."""
        stored = {record.photo_id for record in self.records}
        for taken, moment in waiting:
            if taken.command.photo_id in stored:
                self._hands.submit(partial(strike_out, self._folder, taken))
            else:
                await self._store(taken, moment)

    async def all_in(self) -> None:
        """Wait for what is under way, and ask once more for what could not be fetched."""
        if self._tasks:
            await asyncio.wait(self._tasks, timeout=PHOTO_PATIENCE_S)
        missing = list(self._missing.values())
        self._missing.clear()
        try:
            async with asyncio.timeout(PHOTO_PATIENCE_S):
                await asyncio.gather(*(self._take(taken) for taken in missing))
        except TimeoutError:
            log.error("%d photos stay lost", len(self.lost))

    async def _take(self, taken: PhotoTakenMessage) -> None:
        moment = _moment(self._history, taken)
        self._hands.submit(partial(note_pending, self._folder, taken, moment))
        await self._store(taken, moment)

    async def _store(self, taken: PhotoTakenMessage, moment: PhotoMoment | None) -> None:
        loop, hands = asyncio.get_running_loop(), self._hands
        photo_id = taken.command.photo_id
        try:
            jpeg = await loop.run_in_executor(hands.fetchers, fetch, taken.url)
            photo = await loop.run_in_executor(
                hands.fetchers,
                store,
                jpeg,
                taken,
                self._site,
                hands.settings,
                self._folder,
                moment,
                self._seen_before,
            )
        except (PhotoLost, NotAJpeg, OSError) as error:
            log.error("photo %d lost: %s", photo_id, error)
            self.lost[photo_id] = f"photo {photo_id}: {error}"
            if isinstance(error, PhotoLost):
                self._missing[photo_id] = taken
            self._tell(PhotoResultMessage(photo_id=photo_id, kept=False, reason=str(error)))
            return
        hands.submit(partial(strike_out, self._folder, taken))
        self.lost.pop(photo_id, None)
        self._history.take_sightings(taken.stamp_s, photo.sightings)
        record = photo.record
        self.records.append(record)
        repeated = taken.command.repeated
        again = asks_again(record, self._again, len(self.records), repeated=repeated)
        self._again += bool(again)
        self._tell(
            PhotoResultMessage(
                photo_id=photo_id,
                kept=record.kept and not again,
                reason=record.reason or again,
                stamp_s=taken.stamp_s,
                # A disc about a foot that the picture was not found to have may lie beside it.
                mean_grey=None if record.blade_grey is None else record.mean_grey,
                exposed=record.exposure_in_range is not False,
                beside_w=None if photo.beside_w is None else vec3(photo.beside_w),
            )
        )

    def _tell(self, result: PhotoResultMessage) -> None:
        self._hands.bus.publish(Key.PHOTO_RESULT, result.model_dump_json().encode())


def _moment(history: PhotoHistory, taken: PhotoTakenMessage) -> PhotoMoment | None:
    """Return what was known when a photo was taken; None leaves it to the photo's own message."""
    try:
        return history.moment(taken)
    except (ValueError, ArithmeticError, IndexError):
        log.exception("what was known at photo %d cannot be told", taken.command.photo_id)
        return None


def photo_site(settings: Settings, name: str) -> PhotoSite:
    """Return what is known of a site; a turbine that is not known leaves only its name."""
    for site in settings.sites:
        if site.name == name:
            try:
                turbine = load_turbine(site.turbine, site.scale)
            except ConfigError as error:
                log.error("%s", error)
                turbine = None
            return PhotoSite(name, turbine, tuple(site.blade_serials.items()))
    return PhotoSite(name)
