"""Which mission may be gone on with: found by its folder, asked for as it was."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from mission.flight.command import MissionState
from mission.records.files import MISSION
from mission.records.flights import FlightRecord, last_number, read_flights
from mission.remote.messages import Intent, StartRequest
from mission.remote.started import REQUEST


class NotResumable(ValueError):
    """There is nothing to go on with, and why."""


@dataclass(frozen=True, slots=True)
class Unfinished:
    """A mission that can go on."""

    folder: Path
    request: StartRequest
    """As it was first started."""
    asked: Intent | None
    """What flight was first handed; None where not even that was written down."""
    flight: int
    """Number of the next flight."""
    last: FlightRecord | None

    @property
    def broken_off(self) -> bool:
        """Whether the last flight never told its end."""
        return self.last is None or not self.last.ended


def unfinished(missions: Path, name: str) -> Unfinished:
    """Return the mission of this folder name, or the newest. Raises `NotResumable`."""
    folders = sorted(file.parent for file in missions.glob(f"*/{REQUEST}"))
    if name:
        folder = missions / name
        if folder not in folders:
            raise NotResumable(f"no mission {name!r} was started here")
    elif folders:
        folder = folders[-1]
    else:
        raise NotResumable("no mission is running, and none was started before")
    try:
        request = StartRequest.model_validate_json((folder / REQUEST).read_bytes())
    except (OSError, ValidationError) as error:
        raise NotResumable(f"{folder.name}: its request cannot be read") from error
    flights = read_flights(folder)
    last = flights[-1] if flights else None
    if not flights and (folder / MISSION).is_file():
        raise NotResumable(f"{folder.name} was flown by an older version: it keeps no journal")
    if last is not None and last.state is MissionState.COMPLETED:
        raise NotResumable(f"{folder.name} is completed")
    asked = flights[0].intent if flights else None
    return Unfinished(folder, request, asked, last_number(folder) + 1, last)
