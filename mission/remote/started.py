"""Which requests have started which mission.

Kept in the mission folders, so that a request that is repeated after the daemon was started anew
is no second mission.
"""

from __future__ import annotations

import logging
from pathlib import Path

from pydantic import ValidationError

from mission.remote.messages import StartRequest

log = logging.getLogger(__name__)

REQUEST = "request.json"
#: The newest folders that are looked into when the daemon starts.
REMEMBERED = 200


class Started:
    """The requests that have started a mission, by their id."""

    def __init__(self, missions: Path) -> None:
        self._requests: dict[str, tuple[StartRequest, str]] = {}
        try:
            folders = sorted(missions.resolve().glob(f"*/{REQUEST}"))[-REMEMBERED:]
        except OSError as error:
            log.warning("%s: %s", missions, error)
            return
        for file in folders:
            try:
                request = StartRequest.model_validate_json(file.read_bytes())
            except (OSError, ValidationError) as error:
                log.warning("%s is not remembered: %s", file, error)
                continue
            self._requests[request.id] = request, str(file.parent)

    def of(self, request_id: str) -> tuple[StartRequest, str] | None:
        """Return what this id has started, and its mission folder; None: nothing."""
        return self._requests.get(request_id)

    def keep(self, request: StartRequest, folder: Path) -> None:
        """Remember a request with the folder that was made for it. Raises `OSError`.

        It is not waited for until the disk has it: the requester waits for the reply.
        """
        part = folder / f"{REQUEST}.part"
        part.write_text(request.model_dump_json())
        part.replace(folder / REQUEST)
        self._requests[request.id] = request, str(folder)
