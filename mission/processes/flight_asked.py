"""What is asked of the flight process: a mission, requests while it flies, what came before it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime

from config.presets import load_turbine
from config.settings import Settings
from config.turbine import Site, Turbine
from drivers.bus import Bus, Key, Sample
from mission.flight.earlier import Earlier
from mission.flight.machine import Machine
from mission.flight.observation import Request, RequestKind
from mission.remote.asked_site import asked_site
from mission.remote.messages import EarlierMessage, Intent


@dataclass(frozen=True, slots=True)
class AskedMission:
    """The mission that was asked for last."""

    intent: Intent
    site: Site
    turbine: Turbine
    started_utc: str


class Asked:
    """Listens on the bus; the tick takes what has come."""

    def __init__(self, bus: Bus, settings: Settings, begin: Callable[[Machine], None]) -> None:
        """``begin`` is called with the machine of a mission as it is asked for."""
        self._settings = settings
        self._begin = begin
        self._requests: list[Request] = []
        self._earlier: EarlierMessage | None = None
        self.mission: AskedMission | None = None
        self.news = asyncio.Event()
        """Something was asked for since this was cleared."""
        bus.subscribe(Key.INTENT, self._take_intent)
        bus.subscribe(Key.EARLIER, self._take_earlier)

    @property
    def intent(self) -> Intent | None:
        """What the mission was asked for with; None: none was."""
        return None if self.mission is None else self.mission.intent

    def requests(self) -> tuple[Request, ...]:
        """Return what was asked since the last tick."""
        requests, self._requests = tuple(self._requests), []
        return requests

    def earlier(self) -> Earlier | None:
        """Return what earlier flights of this mission left behind, once."""
        told, intent = self._earlier, self.intent
        if told is None or intent is None:
            return None
        self._earlier = None
        mine = (told.mission_dir, told.flight) == (intent.mission_dir, intent.flight)
        return told.earlier if mine else None

    def _take_intent(self, sample: Sample) -> None:
        intent = Intent.model_validate_json(sample.payload)
        if intent.kind is RequestKind.START:
            self._start(intent)
        self.news.set()
        self._requests.append(
            Request(
                kind=intent.kind,
                request_id=intent.id,
                site=intent.site,
                operator=intent.operator,
                rotor_locked=intent.rotor_locked,
                blades=intent.blades,
                sides=intent.sides,
                flight=intent.flight,
                airborne=intent.airborne,
                rendezvous_w=intent.rendezvous_w,
            )
        )

    def _take_earlier(self, sample: Sample) -> None:
        self._earlier = EarlierMessage.model_validate_json(sample.payload)

    def _start(self, intent: Intent) -> None:
        sites = {site.name: site for site in self._settings.sites}
        site = asked_site(sites[intent.site], intent)
        turbine = load_turbine(site.turbine, site.scale)
        chosen = self._settings.inspection.model_copy(
            update={"blades": intent.blades, "sides": intent.sides}
        )
        settings = self._settings.model_copy(update={"inspection": chosen})
        self._requests.clear()
        started_utc = datetime.now(UTC).isoformat(timespec="seconds")
        self.mission = AskedMission(intent, site, turbine, started_utc)
        self._begin(Machine(settings, site, turbine))
