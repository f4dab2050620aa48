"""The checks before take-off as the flight process makes them: parameters are read once."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

from config.settings import Settings
from config.turbine import Turbine
from drivers.autopilot import AutopilotLink
from drivers.autopilot_errors import AutopilotError
from mission.flight.command import Phase
from mission.flight.machine import Machine
from mission.flight.observation import PreflightItem
from mission.processes.flight_asked import AskedMission
from mission.processes.flight_inputs import FlightInputs
from mission.processes.preflight import preflight_items, read_parameters
from mission.processes.preflight_telemetry import telemetry_item

log = logging.getLogger(__name__)


class FlightChecks:
    """Checks of one mission after the other."""

    def __init__(self, settings: Settings, inputs: FlightInputs) -> None:
        self._settings = settings
        self._inputs = inputs
        self.begin()

    def begin(self) -> None:
        """A new mission begins: its vehicle may be another one."""
        self._parameters: dict[str, float] | None = None
        self._reading: asyncio.Task[None] | None = None

    def items(
        self, link: AutopilotLink, machine: Machine | None, mission: AskedMission | None
    ) -> tuple[PreflightItem, ...]:
        """Return the checks, once the parameters were read; only before take-off."""
        if machine is None or mission is None:
            return ()
        if self._reading is None:
            self._reading = asyncio.create_task(self._read_parameters(link, mission.turbine))
        reading = link.vehicle()
        armed = reading is not None and reading.armed
        if armed and not (mission.intent.airborne and machine.phase is Phase.PREFLIGHT):
            return ()
        if self._parameters is None:
            return (PreflightItem("parameters", False, "being read from the autopilot"),)
        items = preflight_items(
            self._settings,
            mission.turbine,
            reading,
            self._parameters,
            self._inputs.sensing,
            self._inputs.ready,
            Path(mission.intent.mission_dir),
        )
        items += (telemetry_item(reading, awake=link.awake),)
        # A vehicle in the air is not going to be armed.
        return tuple(item for item in items if not armed or item.name != "vehicle")

    async def _read_parameters(self, link: AutopilotLink, turbine: Turbine) -> None:
        reading = link.vehicle()
        flying = reading is not None and reading.armed
        mend = self._settings.autopilot.set_parameters and not flying
        try:
            parameters = await read_parameters(link, turbine, mend=mend)
        except AutopilotError as error:
            log.warning("parameters: %s", error)
            parameters = {}
        self._parameters = parameters
