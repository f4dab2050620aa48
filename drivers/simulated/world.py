"""The simulated world in mission time: aircraft, its MAVLink ends, and truth for the renderer."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from config.settings import Settings
from drivers.clock import Clock, sleep_until
from drivers.simulated.aircraft import TICK_S, Aircraft
from drivers.simulated.link import CameraSetting, FaultChange, StillRequest, TruthState
from drivers.simulated.mavlink_autopilot import MockAutopilot
from drivers.simulated.mavlink_payload import MockPayload
from drivers.simulated.mavlink_wire import MavlinkLink, Received
from drivers.simulated.ned import Home
from drivers.simulated.px4_modes import Mode
from drivers.simulated.scene import Scene
from drivers.simulated.setpoint_timing import SetpointTiming
from drivers.simulated.truth_report import WorldFacts

ToRenderer = TruthState | CameraSetting | StillRequest | FaultChange
#: Ticks made up for at one go before the event loop gets its turn.
_MAX_BURST = 10
_AUTOPILOT_DEVICES = ("gps", "compass", "baro", "battery")


class World:
    """Steps everything but the renderer, 50 times a mission second."""

    def __init__(
        self,
        settings: Settings,
        scene: Scene,
        clock: Clock,
        to_renderer: Callable[[ToRenderer], None],
    ) -> None:
        autopilot, seed = settings.autopilot, settings.simulation.seed
        self._clock, self._to_renderer, self._scene = clock, to_renderer, scene
        self.aircraft = Aircraft(settings, scene)
        self.timing = SetpointTiming()
        self.link = MavlinkLink(autopilot.url, seed=seed)
        self.link.on_arrival = self._arrived
        aircraft = self.aircraft
        self._mock = MockAutopilot(
            self.link, autopilot.system_id, aircraft.parameters, aircraft.commander,
            aircraft.guidance, aircraft.telemetry,
        )  # fmt: skip
        self.payload_link = (
            MavlinkLink(autopilot.payload_url, seed=seed + 1) if autopilot.payload_url else None
        )
        self.payload = MockPayload(
            settings, self.payload_link or self.link, aircraft.telemetry, to_renderer,
            shared=self.payload_link is None,
        )  # fmt: skip
        self.now_s = clock.now_s()
        self.faults_applied: list[dict[str, str | float]] = []

    @property
    def links(self) -> tuple[MavlinkLink, ...]:
        """The open links."""
        return (self.link,) if self.payload_link is None else (self.link, self.payload_link)

    @property
    def home(self) -> Home:
        """Geodetic place of the take-off point."""
        return self.aircraft.telemetry.home

    @property
    def airborne(self) -> bool:
        """Whether the vehicle is off the ground."""
        return not self.aircraft.body.on_ground

    async def start(self) -> None:
        """Tell the renderer the first state."""
        self._tell_truth()
        self.payload.camera.start()

    async def run(self) -> None:
        """Step with the clock until cancelled; reads the links as datagrams come."""
        loop = asyncio.get_running_loop()
        for link in self.links:
            loop.add_reader(link.fileno(), self._read, link)
        try:
            while True:
                await sleep_until(self._clock, self.now_s + TICK_S)
                # A real autopilot is not kept from its link: what came meanwhile came in time.
                for link in self.links:
                    self._read(link)
                behind = int((self._clock.now_s() - self.now_s) / TICK_S)
                for _ in range(min(max(behind, 1), _MAX_BURST)):
                    self.step()
        finally:
            for link in self.links:
                loop.remove_reader(link.fileno())

    def close(self) -> None:
        """Close the links."""
        for link in self.links:
            link.close()

    def step(self) -> None:
        """Advance the world by one tick."""
        self.now_s += TICK_S
        now_s = self.now_s
        for received in self.link.due(now_s):
            if self.payload_link is not None or not self.payload.handle(received):
                self._mock.handle(received)
        if self.payload_link is not None:
            for received in self.payload_link.due(now_s):
                self.payload.handle(received)
        self.aircraft.step(now_s)
        self.payload.step(TICK_S)
        self._tell_truth()
        self._mock.step()
        for link in self.links:
            link.flush(now_s)

    def swap_battery(self) -> None:
        """Fit a charged battery, where the vehicle stands on the ground."""
        if not self.airborne:
            self.aircraft.pack.renew()

    def pilot_returns(self) -> None:
        """The pilot sends the vehicle home: up above the rotor, over, down."""
        self.aircraft.commander.set_mode(Mode.RETURN, self.now_s)

    def fault(self, device: str, word: str) -> None:
        """Change a device's failure word; devices of the renderer are passed on."""
        if device == "link":
            self.link.fault(word)
        elif device in _AUTOPILOT_DEVICES:
            self.aircraft.fault(device, word)
        elif device == "gimbal":
            self.payload.gimbal.fault(word)
        else:
            if device == "camera":
                self.payload.camera.fault(word)
            self._to_renderer(FaultChange(device, word))
        self.faults_applied.append({"device": device, "word": word, "at_s": round(self.now_s, 3)})

    def facts(self) -> WorldFacts:
        """Return what is true of the flight so far."""
        aircraft, gaps = self.aircraft, self.timing.gaps()
        counts = self.link.counts
        return WorldFacts(
            mission_s=self.now_s,
            setpoint_gap_ms=gaps[0].as_json(),
            setpoint_gap_wall_ms=gaps[1].as_json(),
            setpoints=self.timing.count,
            offboard_losses=aircraft.commander.offboard_losses,
            landed=aircraft.body.on_ground,
            armed=aircraft.commander.armed,
            took_off=aircraft.took_off,
            touchdown_mps=aircraft.body.touchdown_mps,
            wind_mean_mps=self._scene.wind_mean_mps,
            wind_from_deg=self._scene.wind_from_deg,
            wind_max_mps=aircraft.wind.max_mps,
            battery_left=round(aircraft.pack.charge, 4),
            energy_wh=round(aircraft.pack.used_wh, 2),
            landing_error_m=aircraft.distance_from_launch_m,
            link={"sent": counts.sent, "received": counts.received, "dropped": counts.dropped},
            faults=self.faults_applied,
        )

    def _read(self, link: MavlinkLink) -> None:
        link.read(self._clock.now_s(), self._clock.mission_time_of)

    def _arrived(self, received: Received) -> None:
        message = received.message
        if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED" and self._mock.is_for_us(message):
            self.timing.arrived(
                self._clock.mission_time_of(received.arrival_ns),
                received.arrival_ns,
                offboard=self.aircraft.offboard,
            )

    def _tell_truth(self) -> None:
        aircraft = self.aircraft
        body = aircraft.body
        camera = self.payload.gimbal.truth(body.yaw_rad, TICK_S)
        self._to_renderer(
            TruthState(
                t_s=self.now_s,
                position_w=body.position_w,
                velocity_w=body.velocity_w,
                quaternion_wb=aircraft.quaternion_wb,
                angular_rate_b=aircraft.rates_b,
                camera_quaternion_wc=camera.quaternion_wc,
                camera_rate_rps=camera.rate_rps,
            )
        )
