"""Room on the disk: the live picture is left out first, photos and their records never.

A mission begins only with `MIN_FREE_BYTES` (preflight); what fills the disk meanwhile is somebody
else. The recording gives way in two steps, so that photos, their records, the event log and
mission.json still find room: without it a photo could be flown for and not be kept.
"""

from __future__ import annotations

import shutil
from enum import IntEnum
from pathlib import Path

#: With less than this the live picture is recorded no more; with less than that nothing is.
PICTURES_NEED_BYTES = 512 << 20
RECORDING_NEEDS_BYTES = 256 << 20


class Room(IntEnum):
    """What there is room for."""

    PHOTOS = 0
    """Photos, their records, the event log."""
    RECORDING = 1
    """The recording, without the live picture."""
    EVERYTHING = 2


_LEFT_OUT = {
    Room.RECORDING: "the live picture is not in the recording",
    Room.PHOTOS: "the recording ends",
}


class RoomWatch:
    """Looks now and then how much room is left; what was given up is not taken up again."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.room = Room.EVERYTHING
        self.words: tuple[str, ...] = ()
        """What was given up, since when and why."""

    def look(self, mission_s: float) -> None:
        """Look at the disk; one that does not say is taken to have room."""
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError:
            return
        room = Room.EVERYTHING
        if free < RECORDING_NEEDS_BYTES:
            room = Room.PHOTOS
        elif free < PICTURES_NEED_BYTES:
            room = Room.RECORDING
        if room < self.room:
            self.room = room
            told = f"{_LEFT_OUT[room]} from mission second {mission_s:.0f} on"
            self.words += (f"{told}: {free >> 20} MiB were left on the disk",)
