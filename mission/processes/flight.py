"""The flight process: MAVSDK, the 20 Hz control tick, machine and guard. No disk, no fits.

Setpoints leave from the tick alone, synchronously: a dead loop is silence, and silence is the
autopilot's failsafe (`mission/processes/dead_man.py`).
"""

from __future__ import annotations

import asyncio
import logging
from concurrent.futures import ThreadPoolExecutor

from drivers.autopilot import AutopilotLink
from drivers.autopilot_announcer import Announcer
from drivers.autopilot_errors import AutopilotError
from drivers.autopilot_tap import TAP_FILE
from drivers.bus import Bus
from drivers.clock import sleep_until
from drivers.payload import Payload, PhotoTaken
from mission.flight.command import (
    TERMINAL,
    Action,
    Command,
    MissionState,
    Phase,
    PhotoCommand,
    Progress,
    Setpoint,
)
from mission.flight.events import EventRecord
from mission.flight.guard import Guard, GuardedCommand
from mission.flight.machine import Machine
from mission.flight.observation import (
    ExposureState,
    FlightMode,
    Observation,
)
from mission.processes.dead_man import DeadMan
from mission.processes.flight_announcements import Announcements
from mission.processes.flight_asked import Asked
from mission.processes.flight_checks import FlightChecks
from mission.processes.flight_inputs import (
    FlightInputs,
    camera_part,
    gimbal_part,
    vehicle_part,
)
from mission.processes.flight_outputs import FlightOutputs
from mission.processes.flight_pace import Pace
from mission.processes.runtime import Runtime, run_process

log = logging.getLogger(__name__)

TICK_S = 0.05
#: Between missions, disarmed: the state is still told twice a second.
REST_TICK_S = 0.5
#: Ticks missed by more than this are left out, not made up for; so is a rest that ends early.
MAX_LATE_S = 0.1
RECONNECT_S = 2.0
#: How much of a flight's figures a lost process may cost.
JOURNAL_S = 5.0
UNFLOWN = (Phase.IDLE, Phase.PREFLIGHT)
IDLE_PROGRESS = Progress(Phase.IDLE, MissionState.IDLE, "ready")


class Flight:
    """Machine and guard between the vehicle's link and the bus."""

    def __init__(self, runtime: Runtime, bus: Bus) -> None:
        self._settings = runtime.settings
        self._clock = runtime.clock
        self._bus = bus
        self._tap_file = runtime.run_dir / TAP_FILE
        self._inputs = FlightInputs(bus, self._follow_light)
        self._pace = Pace()
        self._outputs = FlightOutputs(bus, runtime, self._pace)
        self._announcements: Announcements | None = None
        self._guard = Guard(runtime.settings)
        self._checks = FlightChecks(runtime.settings, self._inputs)
        self._machine: Machine | None = None
        self._link: AutopilotLink | None = None
        self._payload: Payload | None = None
        self._action: asyncio.Task[None] | None = None
        self._refused: str | None = None
        self._previous: Setpoint | None = None
        self._guard_words = ""
        self._dead_man = DeadMan()
        self._tick = 0
        self._link_words = "looking for the vehicle"
        self._photo_commands: dict[int, PhotoCommand] = {}
        self._last_observation: Observation | None = None
        self._progress = IDLE_PROGRESS
        self._reported = True
        self._journal_s = 0.0
        self._asked = Asked(bus, runtime.settings, self._begin)

    async def run(self) -> None:
        """Find the vehicle and fly what is asked for, until cancelled."""
        idle = asyncio.create_task(self._report_while_unconnected())
        try:
            while True:
                try:
                    async with AutopilotLink(
                        self._settings.autopilot, self._clock, self._tap_file
                    ) as link:
                        self._link, self._link_words = link, ""
                        # A camera on the vehicle's own link tells of its photos by itself.
                        apart = bool(self._settings.autopilot.payload_url)
                        self._announcements = Announcements(Announcer(link.wire), photos=apart)
                        async with Payload(
                            link,
                            self._settings,
                            self._clock,
                            self._on_photo,
                            self._on_photo_failed,
                        ) as payload:
                            self._payload = payload
                            await self._ticks(link, payload)
                except AutopilotError as error:
                    self._link = None
                    self._link_words = str(error)
                    log.error("%s", error)
                    self._refuse_unconnected()
                await asyncio.sleep(RECONNECT_S)
        finally:
            idle.cancel()

    async def _report_while_unconnected(self) -> None:
        while True:
            if self._link is None:
                progress = Progress(Phase.IDLE, MissionState.IDLE, self._link_words)
                self._outputs.state(
                    progress, None, self._inputs, self._asked.intent, link_ok=False, resting=True
                )
            await asyncio.sleep(0.2)

    def _refuse_unconnected(self) -> None:
        """A mission that was asked for while there is no vehicle ends here."""
        if self._asked.intent is None or self._reported:
            return
        progress = Progress(Phase.IDLE, MissionState.FAILED, self._link_words)
        self._outputs.state(progress, None, self._inputs, self._asked.intent, link_ok=False)

    # --- the tick ---------------------------------------------------------------------------

    async def _ticks(self, link: AutopilotLink, payload: Payload) -> None:
        try:
            next_s = self._clock.now_s()
            while True:
                if self._resting(link):
                    next_s += REST_TICK_S
                    await self._rest_until(next_s)
                else:
                    next_s += TICK_S
                    await sleep_until(self._clock, next_s)
                now_s = self._clock.now_s()
                late_s = now_s - next_s
                if abs(late_s) > MAX_LATE_S:
                    next_s = now_s
                self._one_tick(link, payload, now_s, late_s)
        finally:
            # Our last word: whatever ends this process, the vehicle is asked to hold.
            await self._hold_if_flying(link)

    async def _rest_until(self, mission_s: float) -> None:
        """Wait until a mission time, or until something is asked for."""
        self._asked.news.clear()
        waiting = asyncio.create_task(sleep_until(self._clock, mission_s))
        asked = asyncio.create_task(self._asked.news.wait())
        try:
            await asyncio.wait((waiting, asked), return_when=asyncio.FIRST_COMPLETED)
        finally:
            waiting.cancel()
            asked.cancel()

    def _resting(self, link: AutopilotLink) -> bool:
        """Nothing flies and nothing shall."""
        reading = link.vehicle()
        return self._machine is None and (reading is None or not reading.armed)

    async def _hold_if_flying(self, link: AutopilotLink) -> None:
        reading = link.vehicle()
        if reading is None or FlightMode(reading.mode) is not FlightMode.OFFBOARD:
            return
        try:
            async with asyncio.timeout(1.5):
                await asyncio.shield(link.act("hold"))
        except (AutopilotError, TimeoutError) as error:
            log.error("hold was not acknowledged: %s", error)

    def _one_tick(self, link: AutopilotLink, payload: Payload, now_s: float, late_s: float) -> None:
        self._tick += 1
        resting = self._resting(link)
        link.rest(resting)
        payload.rest(resting)
        observation = self._observe(link, payload, now_s, late_s)
        self._last_observation = observation
        self._pace.lag_ms.note(now_s, max(0.0, late_s) * 1e3)
        machine = self._machine
        if self._announcements is not None:
            self._announcements.tick(self._progress, observation, self._inputs)
        if machine is None:
            self._outputs.vehicle(observation)
            if self._tick % 4 == 0 or resting:
                self._outputs.state(
                    self._progress, observation, self._inputs, self._asked.intent, resting=resting
                )
            return
        command, events = machine.step(observation)
        surroundings = self._inputs.surroundings
        guarded = self._guard.check(
            command, observation, surroundings, machine.airspace(), self._previous
        )
        sent = self._send(link, payload, guarded, observation)
        self._outputs.tick(observation, guarded, sent=sent, surroundings_s=surroundings.stamp_s)
        self._after(machine, observation, guarded, events)

    def _observe(
        self, link: AutopilotLink, payload: Payload, now_s: float, late_s: float
    ) -> Observation:
        inputs = self._inputs
        refused, self._refused = self._refused, None
        sensing = inputs.sensing
        alive = sensing is None or now_s - sensing.mission_s < 2.5
        engaged = self._machine is not None and self._machine.engaged
        return Observation(
            now_s=now_s,
            tick=self._tick,
            vehicle=vehicle_part(link.vehicle()),
            gimbal=gimbal_part(payload.gimbal()),
            camera=camera_part(payload.camera()),
            clearance=inputs.clearance,
            hub_prior=inputs.hub_prior,
            rotor=inputs.rotor,
            blade=inputs.blade,
            exposure=inputs.exposure,
            photos=inputs.photos(),
            requests=self._asked.requests(),
            preflight=self._checks.items(link, self._machine, self._asked.mission),
            offboard_refused=refused,
            sensing_alive=alive,
            late_s=max(0.0, late_s),
            silent=self._dead_man.look(now_s, engaged=engaged),
            guard_refused=self._guard_words,
            earlier=None if self._machine is None else self._asked.earlier(),
        )

    def _send(
        self,
        link: AutopilotLink,
        payload: Payload,
        guarded: GuardedCommand,
        observation: Observation,
    ) -> bool:
        """Carry out a tick's command; return whether its setpoint left."""
        command = guarded.command
        sent = False
        self._guard_words = guarded.reason if guarded.refused else ""
        if command.setpoint is not None and self._may_send(observation):
            setpoint = command.setpoint
            link.send_setpoint(setpoint.position_w, setpoint.velocity_w, setpoint.yaw_rad)
            gap_s = self._dead_man.sent(observation.now_s)
            if gap_s is not None:
                self._pace.gap(observation.now_s, gap_s * 1e3)
            self._previous, sent = setpoint, True
        elif command.setpoint is None:
            self._previous = None
        if command.gimbal is not None and self._tick % 2 == 0:
            payload.aim(command.gimbal.yaw_rad, command.gimbal.pitch_rad)
        if command.ev is not None:
            payload.want_ev(command.ev)
        if command.photo is not None:
            self._photo_commands[command.photo.photo_id] = command.photo
            payload.take_photo(command.photo.photo_id)
        if command.action is not None and (self._action is None or self._action.done()):
            height_m = command.takeoff_height_m or 0.0
            self._action = asyncio.create_task(self._act(link, command.action, height_m))
        return sent

    def _follow_light(self, exposure: ExposureState) -> None:
        """Along a blade, order what metering asks for at once: a tick later is a frame later."""
        along = self._machine is not None and self._progress.phase is Phase.TRACK
        if along and self._payload is not None:
            self._payload.want_ev(exposure.ev_wanted)

    def _may_send(self, observation: Observation) -> bool:
        vehicle = observation.vehicle
        stamp_s = None if vehicle is None else vehicle.mode_stamp_s
        return self._dead_man.may_send(observation.now_s, self._clock.now_s(), stamp_s)

    async def _act(self, link: AutopilotLink, action: Action, height_m: float) -> None:
        try:
            await link.act(action, height_m)
        except AutopilotError as error:
            log.warning("%s: %s", action, error)
            self._refused = str(error)

    # --- what leaves --------------------------------------------------------------------------

    def _after(
        self,
        machine: Machine,
        observation: Observation,
        guarded: GuardedCommand,
        events: tuple[EventRecord, ...],
    ) -> None:
        command: Command = guarded.command
        # How a mission ended stays on show until the next one begins.
        self._progress = command.progress
        self._outputs.vehicle(observation)
        self._outputs.task(command.sensing, observation.now_s)
        for event in events:
            self._outputs.event(event)
        if self._announcements is not None:
            self._announcements.events(events)
        ended = command.progress.state in TERMINAL
        if self._tick % 4 == 0 or ended:
            self._outputs.state(command.progress, observation, self._inputs, self._asked.intent)
        elif observation.now_s - self._journal_s >= JOURNAL_S:
            self._journal_s = observation.now_s
            self._keep_journal(machine)
        if ended:
            self._end(machine)

    def _keep_journal(self, machine: Machine) -> None:
        mission = self._asked.mission
        if mission is not None and machine.phase not in UNFLOWN:
            newest = self._last_observation
            vehicle = None if newest is None else newest.vehicle
            self._outputs.journal(machine, mission, vehicle)

    def _end(self, machine: Machine) -> None:
        """Hand the report to the recorder, once; the machine is done."""
        mission = self._asked.mission
        self._machine = None
        if mission is None or self._reported:
            return
        self._reported = True
        self._outputs.report(machine, mission, self._inputs, self._pace.spread())

    def _on_photo(self, photo: PhotoTaken) -> None:
        command = self._photo_commands.pop(photo.photo_id, None)
        if command is None or self._last_observation is None:
            return
        try:
            taken = self._outputs.photo(photo, command, self._last_observation)
        except ValueError:  # one photo that cannot be told must not end all others
            log.exception("photo %d lost: it cannot be told", photo.photo_id)
            return
        if taken is not None and self._announcements is not None:
            self._announcements.photo(taken)

    def _on_photo_failed(self, photo_id: int, reason: str) -> None:
        self._photo_commands.pop(photo_id, None)
        log.warning("photo %d failed: %s", photo_id, reason)

    def _begin(self, machine: Machine) -> None:
        """A mission was asked for."""
        self._inputs.forget()
        self._machine = machine
        self._outputs.begin()
        self._checks.begin()
        self._pace.begin()
        self._photo_commands.clear()
        self._reported = False


async def fly(runtime: Runtime) -> None:
    """Run the flight process until cancelled."""
    loop = asyncio.get_running_loop()
    loop.set_default_executor(_executor())
    with runtime.open_bus() as bus:
        await Flight(runtime, bus).run()


def _executor() -> ThreadPoolExecutor:
    """Return a large executor: every MAVSDK call occupies a thread of it until it is answered."""
    return ThreadPoolExecutor(32, "mavsdk")


if __name__ == "__main__":
    run_process("flight", fly, niceness=-10)
