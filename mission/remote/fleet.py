"""All vehicles of one router at once: who is up, how each stands, how old that is."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

from config.links import Bus as BusSettings
from drivers.bus import Bus, Key, Sample
from mission.remote.client import own_name, probe
from mission.remote.messages import EventMessage, StateMessage
from mission.remote.understood import understood

#: A daemon tells its state five times a second, at rest twice.
LOST_S = 3.0


@dataclass(frozen=True, slots=True)
class Sighting:
    """The newest state of one vehicle."""

    state: StateMessage
    heard_s: float
    """Monotonic time of its arrival."""

    def age_s(self) -> float:
        """Return how long ago it arrived."""
        return time.monotonic() - self.heard_s


class Fleet:
    """Listens to every vehicle of a router; a context manager."""

    def __init__(
        self,
        bus: BusSettings,
        on_event: Callable[[str, EventMessage], None] | None = None,
    ) -> None:
        """Connect; raises as `mission.remote.client.Client` does.

        ``on_event`` is called with the vehicle's name and the event, on the bus's thread.
        """
        probe(bus.endpoint)
        self.who = own_name(bus)
        self.bus = Bus.open_client(bus, "*")
        self._on_event = on_event
        self._lock = threading.Lock()
        self._seen: dict[str, Sighting] = {}
        self.bus.subscribe(Key.STATE, self._take_state)
        if on_event is not None:
            self.bus.subscribe(Key.EVENT, self._take_event)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the bus."""
        self.bus.close()

    def vehicles(self) -> dict[str, Sighting]:
        """Return the newest of every vehicle heard so far, by name."""
        with self._lock:
            return dict(sorted(self._seen.items()))

    def _take_state(self, sample: Sample) -> None:
        state = understood(sample, StateMessage)
        if state is None:
            return
        with self._lock:
            self._seen[sample.vehicle] = Sighting(state, time.monotonic())

    def _take_event(self, sample: Sample) -> None:
        event = understood(sample, EventMessage)
        if event is not None and self._on_event is not None:
            self._on_event(sample.vehicle, event)
