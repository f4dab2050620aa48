"""What the console knows of every vehicle, and what it asks of them."""

from __future__ import annotations

import json
import logging
import threading
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from pydantic import ValidationError

from config.links import Bus as BusSettings
from drivers.bus import Key, Sample
from drivers.bus_access import ALL_VERBS, request_key
from drivers.codecs import BadMessage, jpeg_of
from mission.remote.client import NO_REPLY
from mission.remote.fleet import Fleet
from mission.remote.messages import EventMessage, MeteringMessage, Reply
from mission.remote.understood import understood

log = logging.getLogger(__name__)

#: A history is asked for at most so often.
HISTORY_PERIOD_S = 1.0
#: And at least so often, so that what was missed on a bad link is made good.
HISTORY_MAX_AGE_S = 10.0
#: The live picture comes over the bus only while somebody looks at it.
LOOKED_AT_S = 4.0
_TURN_S = 0.1


@dataclass(slots=True)
class _Memory:
    """What is known of one vehicle beyond its newest state."""

    history: Reply | None = None
    version: int = 0
    """Counts renewals of the history."""
    asked_s: float = float("-inf")
    photos: int = -1
    folder: str = ""
    changed: bool = True
    picture: bytes = b""
    looked_at_s: float = float("-inf")
    metering: dict[str, object] | None = None
    end_pictures: tuple[Callable[[], None], ...] = ()


class Board:
    """Collects every vehicle's state, history and picture; a context manager."""

    def __init__(self, bus: BusSettings) -> None:
        """Connect; raises as `mission.remote.client.Client` does."""
        self._fleet = Fleet(bus, self._take_event)
        self._memories: dict[str, _Memory] = {}
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._keep_up, name="console", daemon=True)

    @property
    def who(self) -> str:
        """In whose name the console asks."""
        return self._fleet.who

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join()
        self._fleet.close()

    def live(self) -> list[dict[str, object]]:
        """Return the newest state of every vehicle, its age, and the version of its history."""
        found: list[dict[str, object]] = []
        for name, seen in self._fleet.vehicles().items():
            memory = self._memory(name)
            found.append(
                {
                    "name": name,
                    "age_s": round(seen.age_s(), 2),
                    "state": seen.state.model_dump(mode="json"),
                    "version": memory.version,
                    "metering": memory.metering,
                }
            )
        return found

    def history(self, vehicle: str) -> dict[str, object] | None:
        """Return events, photos, rotor and turbines of a vehicle; None: not known yet."""
        history = self._memory(vehicle).history
        if history is None:
            return None
        fields = {"events", "photos", "rotor", "turbines"}
        return history.model_dump(mode="json", include=fields)

    def picture(self, vehicle: str) -> bytes:
        """Return the newest live picture as JPEG; empty: there is none (yet)."""
        if vehicle not in self._fleet.vehicles():
            return b""
        memory = self._memory(vehicle)
        memory.looked_at_s = time.monotonic()
        return memory.picture

    def ask(self, vehicle: str, verb: str, fields: dict[str, object]) -> Reply:
        """Send a request in our name and return its reply; no reply is a refusal, too."""
        if verb not in ALL_VERBS or vehicle not in self._fleet.vehicles():
            return Reply(ok=False, code="bad_request", text=f"no {verb!r} of {vehicle!r}")
        key = request_key(verb, self.who)
        request = {"id": uuid.uuid4().hex} | fields
        raw = self._fleet.bus.request(key, json.dumps(request).encode(), vehicle=vehicle)
        if raw is None:
            return Reply(ok=False, code="no_reply", text=NO_REPLY)
        self._memory(vehicle).changed = True
        return Reply.model_validate_json(raw)

    def _memory(self, vehicle: str) -> _Memory:
        with self._lock:
            return self._memories.setdefault(vehicle, _Memory())

    def _take_event(self, vehicle: str, _: EventMessage) -> None:
        self._memory(vehicle).changed = True

    def _keep_up(self) -> None:
        while not self._closing.wait(_TURN_S):
            for name, seen in self._fleet.vehicles().items():
                memory = self._memory(name)
                photos, folder = seen.state.progress.photos, seen.state.mission_dir
                if (photos, folder) != (memory.photos, memory.folder):
                    memory.photos, memory.folder, memory.changed = photos, folder, True
                self._renew_history(name, memory)
                self._follow_picture(name, memory)

    def _renew_history(self, name: str, memory: _Memory) -> None:
        age_s = time.monotonic() - memory.asked_s
        if age_s < HISTORY_PERIOD_S or not (memory.changed or age_s > HISTORY_MAX_AGE_S):
            return
        memory.asked_s, memory.changed = time.monotonic(), False
        try:
            reply = self.ask(name, "history", {})
        except ValidationError as error:
            log.warning("the history of %s was not understood: %s", name, error)
            return
        memory.changed = False
        if reply.ok:
            memory.history = reply
            memory.version += 1

    def _follow_picture(self, name: str, memory: _Memory) -> None:
        looked_at = time.monotonic() - memory.looked_at_s < LOOKED_AT_S
        if looked_at and not memory.end_pictures:
            bus = self._fleet.bus
            memory.end_pictures = (
                bus.follow(Key.FRAME, self._take_picture, name),
                bus.follow(Key.METERING, self._take_metering, name),
            )
        elif not looked_at and memory.end_pictures:
            for end in memory.end_pictures:
                end()
            memory.end_pictures = ()
            memory.picture, memory.metering = b"", None

    def _take_metering(self, sample: Sample) -> None:
        shown = understood(sample, MeteringMessage)
        if shown is not None:
            self._memory(sample.vehicle).metering = shown.model_dump(mode="json")

    def _take_picture(self, sample: Sample) -> None:
        try:
            self._memory(sample.vehicle).picture = jpeg_of(sample.payload)
        except BadMessage as error:
            log.warning("%s", error)
