"""The daemon's first process: starts the others, answers requests, never flies.

It owns the Zenoh router, validates each request and hands one intent at a time to flight.
"""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

from config.settings import Settings
from drivers.bus import Bus, Key, Sample
from drivers.bus_access import ALL_VERBS, read_roles
from drivers.systemd import Systemd
from mission.flight.observation import RequestKind
from mission.processes.children import Child
from mission.processes.heartbeat import feed_watchdog
from mission.processes.metrics import Figures, MetricsServer
from mission.processes.runtime import SETTINGS_FILE
from mission.remote.desk import TOO_MANY, Desk
from mission.remote.history import History
from mission.remote.messages import EventMessage, Intent, ReadyMessage

log = logging.getLogger(__name__)

_PROCESSES = (
    ("recorder", "mission.processes.recorder"),
    ("sensing", "mission.processes.sensing"),
    ("flight", "mission.processes.flight"),
)


class Supervisor:
    """Children kept alive, requests answered, the newest state kept for late askers."""

    def __init__(self, settings: Settings, run_dir: Path) -> None:
        self._settings = settings
        self._run_dir = run_dir
        camera = settings.camera
        shorter_mm = min(camera.sensor_width_mm, camera.sensor_height_mm)
        self._history = History(view=shorter_mm / camera.focal_length_mm)
        self._bus: Bus | None = None
        self._started: Intent | None = None
        self._linked = False
        keys = settings.bus.keys
        roles = read_roles(Path(keys)) if keys else {}
        self._figures = Figures(self._history, Path(settings.missions_dir), settings.vehicle)
        self._desk = Desk(
            settings, self._history, self._hand_over, self._tell, roles, self._figures.count
        )
        self.ready = asyncio.Event()

    async def run(self, until: asyncio.Event) -> None:
        """Serve until told to end.

        Raises `drivers.bus.BusUnreachable` when the port is taken, or
        `drivers.bus_session.BusNotSafe`.
        """
        self._run_dir.mkdir(parents=True, exist_ok=True)
        (self._run_dir / SETTINGS_FILE).write_text(self._settings.model_dump_json())
        with (
            Bus.open_router(self._settings.bus, self._settings.vehicle) as bus,
            MetricsServer(self._figures, self._settings.service.metrics_port),
        ):
            self._bus = bus
            self._history.listen(bus)
            bus.subscribe(Key.STATE, self._take_state)
            bus.subscribe(Key.READY, self._take_ready)
            bus.answer_requests(
                ALL_VERBS,
                self._desk.answer,
                per_s=self._settings.bus.requests_per_s,
                too_many=TOO_MANY,
            )
            bus.announce()
            children = [Child(name, module, self._run_dir) for name, module in _PROCESSES]
            watchers = [asyncio.create_task(child.keep_alive(self._on_death)) for child in children]
            feeder = asyncio.create_task(feed_watchdog(self._history, Systemd()))
            stop = asyncio.create_task(until.wait())
            await asyncio.wait([stop, *watchers], return_when=asyncio.FIRST_COMPLETED)
            feeder.cancel()
            # Flight leaves first, so that its last word (hold) goes out at once.
            *others, flight = children
            await flight.end()
            await asyncio.gather(*(child.end() for child in others))
            await asyncio.gather(*watchers)

    def _hand_over(self, intent: Intent) -> None:
        assert self._bus is not None  # noqa: S101 - requests arrive only while the bus is open
        if intent.kind is RequestKind.START:
            self._started = intent
        self._bus.publish(Key.INTENT, intent.model_dump_json().encode())

    def _tell(self, event: EventMessage) -> None:
        if self._bus is not None:
            self._bus.publish(Key.EVENT, event.model_dump_json().encode())

    def _take_state(self, sample: Sample) -> None:
        self._history.take(sample)
        state = self._history.state
        if state is None:
            return
        if not self.ready.is_set():
            self.ready.set()
            log.info("%s takes requests at %s", self._settings.vehicle, self._where())
        if state.link_ok != self._linked:
            self._linked = state.link_ok
            log.info("the vehicle %s", "is heard" if self._linked else "is not heard any more")
        self._desk.take_state(state)

    def _where(self) -> str:
        bus = self._settings.bus
        return " and ".join(one for one in (bus.listen, bus.remote, bus.uplink) if one)

    def _take_ready(self, sample: Sample) -> None:
        """Tell a recorder that came up late, or came back, which mission is under way."""
        ready = ReadyMessage.model_validate_json(sample.payload)
        started = self._started
        if ready.name != "recorder" or started is None or self._bus is None:
            return
        if ready.recording != started.mission_dir and self._desk.under_way:
            self._bus.publish(Key.RECORD, started.model_dump_json().encode())

    def _on_death(self, name: str, deaths: int) -> None:
        self._figures.deaths[name] = self._figures.deaths.get(name, 0) + 1
        if name == "flight":
            self._desk.forget_pending()
        self._tell(
            EventMessage(
                mission_s=0.0 if self._history.state is None else self._history.state.mission_s,
                name=f"{name}_died",
                severity="hold",
                text=f"the {name} process died ({deaths} times within a minute)",
            )
        )
