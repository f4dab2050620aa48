"""Carries out a farm's queue: hears the vehicles, sends the starts, writes the ledger."""

from __future__ import annotations

import logging
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from drivers.bus import BusUnreachable
from mission.records.files import write_whole
from mission.remote.client import Client, NoReply
from mission.remote.farm import (
    Farm,
    Ledger,
    Stage,
    Start,
    VehicleView,
    after_states,
    is_over,
    next_starts,
)
from mission.remote.messages import Code, StateMessage

log = logging.getLogger(__name__)

TURN_S = 0.5
#: A vehicle that was silent for so long does not count as free.
SILENT_S = 3.0
_RETRY_S = 5.0
#: Refusals after which the turbine itself is not to be tried again.
_HOPELESS = (Code.UNKNOWN_TURBINE, Code.BAD_REQUEST, Code.NOT_CONFIRMED)


@dataclass(slots=True)
class _Line:
    """The line to one vehicle, and what came over it."""

    name: str
    router: str
    client: Client | None = None
    state: StateMessage | None = None
    heard_s: float = float("-inf")
    turbines: frozenset[str] = frozenset()
    tried_s: float = float("-inf")

    def take(self, state: StateMessage) -> None:
        """Keep the newest state."""
        self.state, self.heard_s = state, time.monotonic()

    def view(self) -> VehicleView | None:
        """Return what is known, if it is fresh."""
        if self.state is None or time.monotonic() - self.heard_s > SILENT_S:
            return None
        return VehicleView(self.state, self.turbines)


class FarmRun:
    """Flies a farm; a context manager.

    ``ledger_path`` is read where it exists, and written after every step: a run that was ended
    goes on from there. ``tell`` gets a line for everything that happens.
    """

    def __init__(
        self, farm: Farm, ledger_path: Path, keys: str = "", tell: Callable[[str], None] = print
    ) -> None:
        self._farm = farm
        self._path = ledger_path
        self._keys = keys
        self._tell = tell
        self._lines = {
            vehicle.name: _Line(vehicle.name, vehicle.router or farm.router)
            for vehicle in farm.vehicles
        }
        text = ledger_path.read_text() if ledger_path.exists() else "{}"
        self.ledger = Ledger.model_validate_json(text)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for line in self._lines.values():
            if line.client is not None:
                line.client.close()

    def run(self) -> Ledger:
        """Fly until nothing is left that could be flown; return what became of it."""
        while not is_over(self._farm, self.ledger):
            self.step()
            time.sleep(TURN_S)
        return self.ledger

    def step(self) -> None:
        """Connect, hear, and start what can be started now."""
        for line in self._lines.values():
            if line.client is None and time.monotonic() - line.tried_s > _RETRY_S:
                self._connect(line)
        self._resend()
        views = {
            name: view for name, line in self._lines.items() if (view := line.view()) is not None
        }
        before = self.ledger
        self._keep(after_states(self._farm, before, views, time.time()))
        for name, record in self.ledger.turbines.items():
            if record != before.of(name):
                self._tell(f"{name}: {record.words} ({record.stage})")
        for start in next_starts(self._farm, self.ledger, views):
            self._begin(start)

    def _connect(self, line: _Line) -> None:
        line.tried_s = time.monotonic()
        client = None
        try:
            client = Client(line.name, router=line.router, keys=self._keys)
            line.turbines = frozenset(info.name for info in client.turbines())
            client.watch(line.take)
        except (BusUnreachable, NoReply) as error:
            log.info("%s: %s", line.name, error)
            if client is not None:
                client.close()
            return
        line.client = client
        self._tell(f"{line.name} is there")

    def _begin(self, start: Start) -> None:
        record = self.ledger.of(start.turbine)
        # Kept before it is sent: if we end in between, the same id is sent again.
        self._keep(
            self.ledger.with_record(
                start.turbine,
                stage=Stage.FLYING,
                vehicle=start.vehicle,
                request_id=uuid.uuid4().hex,
                mission_dir="",
                started_utc_s=time.time(),
                tries=record.tries + 1,
            )
        )
        self._send(start.turbine)

    def _resend(self) -> None:
        """Send again what was chosen and never answered."""
        for name, record in self.ledger.turbines.items():
            if record.stage is Stage.FLYING and not record.mission_dir:
                self._send(name)

    def _send(self, turbine: str) -> None:
        record = self.ledger.of(turbine)
        line = self._lines.get(record.vehicle)
        if line is None or line.client is None:
            return
        try:
            reply = line.client.start(
                turbine,
                operator=self._farm.operator,
                rotor_locked=True,
                request_id=record.request_id,
            )
        except NoReply as error:
            log.info("%s: %s", record.vehicle, error)
            return
        if reply.ok:
            self._keep(self.ledger.with_record(turbine, mission_dir=reply.mission_dir))
            self._tell(f"{turbine}: {record.vehicle} flies it ({reply.mission_dir})")
            return
        stage = Stage.GIVEN_UP if reply.code in _HOPELESS else Stage.WAITING
        words = f"{record.vehicle}: {reply.text} ({reply.code})"
        tries = record.tries - 1
        self._keep(
            self.ledger.with_record(turbine, stage=stage, words=words, tries=tries, request_id="")
        )
        self._tell(f"{turbine}: {words}")

    def _keep(self, ledger: Ledger) -> None:
        """Take over a ledger and write it, whole or not at all."""
        if ledger == self.ledger and self._path.exists():
            return
        self.ledger = ledger
        write_whole(self._path, (ledger.model_dump_json(indent=2) + "\n").encode())
