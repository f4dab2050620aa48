"""What those who come late are told: newest state, the last events, the photos so far."""

from __future__ import annotations

import logging
import time
from collections import deque

from pydantic import TypeAdapter, ValidationError

from drivers.bus import Bus, Key, Sample
from mission.flight.observation import RotorEstimate
from mission.remote.messages import (
    EventMessage,
    PhotoResultMessage,
    PhotoShown,
    PhotoTakenMessage,
    SensingHealth,
    StateMessage,
)

log = logging.getLogger(__name__)

MAX_EVENTS = 200
MAX_PHOTOS = 2000
_ROTOR = TypeAdapter(RotorEstimate)


class History:
    """Collects from the bus what a late joiner needs; bounded."""

    def __init__(self, view: float = 0.3) -> None:
        """``view``: metres that a picture spans for each metre of distance, the shorter way."""
        self._half_view = view / 2
        self.state: StateMessage | None = None
        self.rotor: RotorEstimate | None = None
        self.sensing: SensingHealth | None = None
        self._state_heard_s = float("-inf")
        self._events: deque[EventMessage] = deque(maxlen=MAX_EVENTS)
        self._photos: dict[int, PhotoShown] = {}
        # A verdict may overtake the photo that it is about: they are different keys.
        self._kept: dict[int, bool] = {}

    @property
    def events(self) -> tuple[EventMessage, ...]:
        """The newest events, oldest first."""
        return tuple(self._events)

    @property
    def photos(self) -> tuple[PhotoShown, ...]:
        """The photos of the mission, oldest first."""
        return tuple(self._photos.values())

    def state_age_s(self) -> float:
        """Return how long ago (wall time) the newest state arrived."""
        return time.monotonic() - self._state_heard_s

    def begin(self) -> None:
        """A new mission begins: nothing of the last one is its own."""
        self._photos.clear()
        self._kept.clear()
        self.rotor = None

    def listen(self, bus: Bus) -> None:
        """Hear everything from now on (the state is handed over by `take`)."""
        for key in (Key.EVENT, Key.PHOTO, Key.PHOTO_RESULT, Key.ROTOR, Key.SENSING):
            bus.subscribe(key, self.take)

    def take(self, sample: Sample) -> None:
        """Take one message from the bus; what cannot be read is left out and logged."""
        try:
            self._take(sample)
        except ValidationError as error:
            log.warning("%s was not understood: %s", sample.key, error)

    def _take(self, sample: Sample) -> None:
        if sample.key == Key.STATE:
            self.state = StateMessage.model_validate_json(sample.payload)
            self._state_heard_s = time.monotonic()
        elif sample.key == Key.EVENT:
            self._events.append(EventMessage.model_validate_json(sample.payload))
        elif sample.key == Key.SENSING:
            self.sensing = SensingHealth.model_validate_json(sample.payload)
        elif sample.key == Key.ROTOR:
            rotor = _ROTOR.validate_json(sample.payload)
            self.rotor = rotor if rotor.refusal is None else self.rotor
        elif sample.key == Key.PHOTO and len(self._photos) < MAX_PHOTOS:
            taken = PhotoTakenMessage.model_validate_json(sample.payload).command
            self._photos[taken.photo_id] = PhotoShown(
                photo_id=taken.photo_id,
                blade=taken.blade,
                side=taken.side,
                metre=taken.metre,
                distance_m=taken.distance_m,
                half_m=taken.distance_m * self._half_view,
                kept=self._kept.get(taken.photo_id),
            )
        elif sample.key == Key.PHOTO_RESULT:
            result = PhotoResultMessage.model_validate_json(sample.payload)
            if len(self._kept) < MAX_PHOTOS:
                self._kept[result.photo_id] = result.kept
            shown = self._photos.get(result.photo_id)
            if shown is not None:
                self._photos[result.photo_id] = shown.model_copy(update={"kept": result.kept})
