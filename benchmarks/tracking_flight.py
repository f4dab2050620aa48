"""One mission of the tracking bench: the machine and the guard against the field's own aircraft.

Everything runs in one process on a virtual clock: body, wind, estimator errors, controller, modes
and gimbal are those of `drivers.simulated`, stepped at 50 Hz; flight ticks at 20 Hz on what was
known 20 ms before. There is no MAVLink, and no picture is drawn: light is taken as steady, the
shutter as the settings have it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from benchmarks.tracking_outline import blade_beside, met_by, outline_of
from benchmarks.tracking_payload import JUDGED_S, Payload, Still
from benchmarks.tracking_senses import Senses
from benchmarks.tracking_trials import Trial
from drivers.simulated.aircraft import TICK_S, Aircraft
from drivers.simulated.position_control import Target
from drivers.simulated.px4_modes import Landed, Mode, Result
from drivers.simulated.raycaster import NO_TRIANGLE, Raycaster
from drivers.simulated.rotor_frame import blade_names
from mission.flight.command import Action, Command, MissionState, Phase, PhotoCommand
from mission.flight.events import EventRecord
from mission.flight.guard import Guard, GuardedCommand
from mission.flight.leg import Leg
from mission.flight.machine import Machine
from mission.flight.observation import (
    CameraState,
    ExposureState,
    FlightMode,
    Observation,
    PhotoResult,
    Request,
    RequestKind,
    Vec3,
    Vehicle,
)
from perception.geometry import vec3

FLIGHT_TICK_S = 0.05
SCAN_S = 0.1
#: A pack with less than this is changed in the air: split flights are counted, not flown. It is
#: what the way home, one pass and the reserve of a fifth take: no further pass would be begun.
CHANGE_PACK_AT = 0.32
NEAR_EVERY = 10
#: How often the outline of a blade is not found in a photo, and how well its place is otherwise.
OUTLINE_MISSED, OUTLINE_SIGMA_M = 0.05, 0.05
#: A photo aimed farther beside the blade's middle than this is one of several rows.
ASIDE_M = 0.1
TERMINAL = frozenset(MissionState) - {
    MissionState.IDLE,
    MissionState.RUNNING,
    MissionState.PAUSED,
}
_MODES = {
    Mode.OFFBOARD: FlightMode.OFFBOARD,
    Mode.HOLD: FlightMode.HOLD,
    Mode.TAKEOFF: FlightMode.TAKEOFF,
    Mode.LAND: FlightMode.LAND,
    Mode.RETURN: FlightMode.RETURN,
}


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """The vehicle on a pass, at one flight tick, truly."""

    t_s: float
    blade: str
    side: str
    wanted_m: float
    """Distance from the blade's axis, square to it, that the plan wants here."""
    distance_m: float
    """True distance from the deflected axis."""
    gust_mps: float


@dataclass(slots=True)
class Flown:
    """What came of a mission."""

    machine: Machine
    stills: list[Still] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)
    events: list[EventRecord] = field(default_factory=list)
    phase_s: dict[str, float] = field(default_factory=dict)
    least_clearance_m: float = float("inf")
    least_in: str = ""
    seconds: float = 0.0
    cpu_s: float = 0.0
    packs: int = 1
    rejected: int = 0
    wind_max_mps: float = 0.0
    in_rows: set[int] = field(default_factory=set)
    """Photos aimed beside the blade's middle on purpose: the blade is wider than the picture."""


class TrackingFlight:
    """The world round a machine."""

    def __init__(
        self,
        trial: Trial,
        caster: Raycaster,
        *,
        blades: tuple[str, ...] = ("A", "B", "C"),
        sides: tuple[str, ...] = ("PS", "SS", "LE", "TE"),
        watch: Callable[[TrackingFlight], None] | None = None,
    ) -> None:
        """``watch`` is called after each flight tick, for a closer look than the figures give."""
        settings = trial.settings
        self.trial = trial
        self.machine = Machine(settings, trial.site, trial.turbine)
        self.aircraft = Aircraft(settings, trial.scene)
        self.payload = Payload(settings, self.aircraft, settings.simulation.seed + 14)
        self.senses = Senses(trial, self.aircraft, caster)
        self.flown = Flown(self.machine)
        self.now_s = 0.0
        self.previous: GuardedCommand | None = None
        self._outlines = {name: outline_of(caster, trial, name) for name in self.senses.blades}
        self._outline_rng = np.random.default_rng([settings.simulation.seed, 0x0E])
        self._watch = watch
        self._caster = caster
        self._guard = Guard(settings)
        self._tick = self._steps = 0
        self._vehicle: Vehicle | None = None
        self._refused: str | None = None
        self._judged: list[tuple[float, int]] = []
        self._requests: list[Request] = [
            Request(RequestKind.START, "1", trial.site.name, "bench", True, blades, sides)
        ]

    def run(self, limit_s: float = 6000.0) -> Flown:
        """Fly until the mission has ended, or the limit."""
        begun = time.process_time()
        next_flight, next_scan = FLIGHT_TICK_S, SCAN_S
        while self.now_s < limit_s:
            self._step_world()
            if self.now_s >= next_scan - 1e-9:
                next_scan += SCAN_S
                self.senses.scan(self.now_s)
            if self.now_s >= next_flight - 1e-9:
                next_flight += FLIGHT_TICK_S
                command = self._fly()
                if command.progress.state in TERMINAL:
                    break
        flown = self.flown
        flown.stills = self.payload.stills
        flown.seconds, flown.cpu_s = self.now_s, time.process_time() - begun
        flown.wind_max_mps = self.aircraft.wind.max_mps
        return flown

    # --- the world --------------------------------------------------------------------------------

    def _step_world(self) -> None:
        aircraft = self.aircraft
        self._vehicle = self._reported()
        self.payload.gimbal_state = self.payload.report(self.now_s, self._vehicle.yaw_rad)
        self.now_s += TICK_S
        self._steps += 1
        aircraft.step(self.now_s)
        self.payload.step(self.now_s)
        if aircraft.pack.charge < CHANGE_PACK_AT:
            aircraft.pack.charge = 1.0
            self.flown.packs += 1
        if self._steps % NEAR_EVERY == 0:
            self._note_clearance()

    def _note_clearance(self) -> None:
        body = self.aircraft.body
        if body.z - self.trial.scene.launch_w[2] < 5.0:
            return
        place = np.array([body.position_w], np.float32)
        free = (
            float(self._caster.clearance_m(place, 0.0)[0]) - self.trial.settings.airframe.radius_m
        )
        if free < self.flown.least_clearance_m:
            self.flown.least_clearance_m = free
            if self.previous is not None:
                progress = self.previous.command.progress
                self.flown.least_in = (
                    f"{progress.phase} {progress.blade} {progress.side}: {progress.words}"
                )

    def _reported(self) -> Vehicle:
        aircraft, commander = self.aircraft, self.aircraft.commander
        told = aircraft.telemetry
        return Vehicle(
            stamp_s=self.now_s,
            position_w=told.position_l,
            velocity_w=told.velocity_l,
            quaternion_wb=told.quaternion_lb,
            yaw_rad=_yaw(told.quaternion_lb),
            mode=_MODES.get(commander.mode, FlightMode.PILOT),
            mode_stamp_s=self.now_s,
            armed=commander.armed,
            in_air=commander.landed is not Landed.ON_GROUND,
            landed=commander.landed is Landed.ON_GROUND,
            heartbeat_stamp_s=self.now_s,
            battery=told.charge,
            battery_stamp_s=self.now_s,
            wind_w=told.wind_l,
            home_w=(0.0, 0.0, 0.0),
            healthy=told.armable or commander.armed,
        )

    # --- flight -----------------------------------------------------------------------------------

    def _fly(self) -> Command:
        self._tick += 1
        observation = self._observe()
        command, events = self.machine.step(observation)
        before = None if self.previous is None else self.previous.command.setpoint
        guarded = self._guard.check(
            command, observation, self.senses.surroundings, self.machine.airspace(), before
        )
        self.previous = guarded
        self._obey(guarded.command)
        flown, phase = self.flown, str(guarded.command.progress.phase)
        flown.events.extend(events)
        flown.phase_s[phase] = flown.phase_s.get(phase, 0.0) + FLIGHT_TICK_S
        self._sample(guarded.command)
        if self._watch is not None:
            self._watch(self)
        return guarded.command

    def _observe(self) -> Observation:
        now, payload, senses = self.now_s, self.payload, self.senses
        requests, self._requests = tuple(self._requests), []
        refused, self._refused = self._refused, None
        words = ""
        if self.previous is not None and self.previous.refused:
            words = self.previous.reason
        return Observation(
            now_s=now,
            tick=self._tick,
            vehicle=self._vehicle,
            gimbal=payload.gimbal_state,
            camera=CameraState(
                now, 0.0, now, shutter_s=payload.shutter_s, last_photo_id=payload.last_photo_id,
                failed_photo_id=payload.failed_photo_id,
            ),
            clearance=senses.clearance,
            hub_prior=senses.prior,
            rotor=senses.rotor,
            blade=senses.blade,
            exposure=ExposureState(now, 135.0, True, 0.0),
            photos=self._results(now),
            requests=requests,
            offboard_refused=refused,
            guard_refused=words,
        )  # fmt: skip

    def _results(self, now_s: float) -> tuple[PhotoResult, ...]:
        """What the recorder says of photos: kept where the blade is in the picture."""
        stills = self.payload.stills
        done = len(self._judged)
        found = []
        while done < len(stills) and now_s - stills[done].t_s > JUDGED_S:
            still = stills[done]
            kept = blade_in_picture(self.trial, still, self._caster)
            self.flown.rejected += not kept
            self._judged.append((now_s, still.command.photo_id))
            reason = "" if kept else "no blade"
            beside_w = self._outline_found(still) if kept else None
            found.append(
                PhotoResult(still.command.photo_id, kept, reason, still.t_s, beside_w=beside_w)
            )
            done += 1
        return tuple(found)

    def _outline_found(self, still: Still) -> Vec3 | None:
        """What the recorder finds in a picture of the blade's place beside the optical axis."""
        rng = self._outline_rng
        missed, error_m = rng.random() < OUTLINE_MISSED, rng.normal(0.0, OUTLINE_SIGMA_M)
        if missed or still.command.photo_id in self.flown.in_rows:
            return None
        blade = self.senses.blades[still.command.blade]
        beside = blade_beside(self.trial, still, blade, self._outlines[still.command.blade])
        if beside is None:
            return None
        tangent, across_w = beside
        _, point = met_by(blade, still.eye_w, still.rotation_wc[:, 2])
        depth_m = float((point - still.eye_w) @ still.rotation_wc[:, 2])
        return vec3((tangent * depth_m + error_m) * across_w)

    def _obey(self, command: Command) -> None:
        aircraft, setpoint = self.aircraft, command.setpoint
        commander = aircraft.commander
        if setpoint is not None:
            commander.setpoint_received(self.now_s)
            aircraft.guidance.offboard = Target(
                setpoint.position_w, setpoint.velocity_w, yaw_rad=setpoint.yaw_rad
            )
        if command.gimbal is not None and self._tick % 2 == 0:
            self.payload.aim(command.gimbal)
        if command.photo is not None:
            self.payload.shoot(command.photo, self.now_s)
            if self._aimed_aside(command.photo):
                self.flown.in_rows.add(command.photo.photo_id)
        self.senses.task(command.sensing, self.now_s)
        if command.action is not None:
            self._act(command.action, command.takeoff_height_m)

    def _act(self, action: Action, height_m: float | None) -> None:
        commander, now = self.aircraft.commander, self.now_s
        if action is Action.ARM:
            result = commander.arm(now)
        elif action is Action.DISARM:
            result = commander.disarm(now)
        elif action is Action.TAKEOFF:
            result = commander.take_off(height_m or 0.0, now)
        else:
            modes = {
                Action.OFFBOARD: Mode.OFFBOARD,
                Action.HOLD: Mode.HOLD,
                Action.RETURN: Mode.RETURN,
                Action.LAND: Mode.LAND,
            }
            result = commander.set_mode(modes[action], now)
        if result is not Result.ACCEPTED:
            self._refused = f"{action}: {result.name}"

    def _aimed_aside(self, photo: PhotoCommand) -> bool:
        """Tell by the plan of the moment: one made after a battery's change lists what is left."""
        legs = () if self.machine.plan is None else self.machine.plan.legs
        return any(
            float(np.linalg.norm(leg.aside(photo.metre))) > ASIDE_M
            for leg in legs
            if (leg.blade, leg.side) == (photo.blade, photo.side)
        )

    def _sample(self, command: Command) -> None:
        """Note the true distance while a pass is flown."""
        progress, leg = command.progress, self.machine.leg
        if progress.phase is not Phase.TRACK or progress.metre is None or leg is None:
            return
        place = np.asarray(self.aircraft.body.position_w)
        metre, point = self.senses.blades[leg.blade].beside(place)
        sample = Sample(
            self.now_s, leg.blade, leg.side, wanted_square_m(leg, metre),
            float(np.linalg.norm(place - point)), self.aircraft.wind.gust_at(self.now_s),
        )  # fmt: skip
        self.flown.samples.append(sample)


def wanted_square_m(leg: Leg, beside_m: float) -> float:
    """Return how far from the axis, square to it, a leg has the vehicle beside a metre."""
    lean = float(leg.view_w @ leg.axis_w)
    return leg.distance_at(leg.looked_at(beside_m)) * math.sqrt(1.0 - lean * lean)


def _yaw(quaternion: tuple[float, float, float, float]) -> float:
    w, x, y, z = quaternion
    return float(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def blade_in_picture(trial: Trial, still: Still, caster: Raycaster) -> bool:
    """Return whether the blade lies in the middle of the picture, as a judge of it would see."""
    axis = still.rotation_wc
    tangents = np.linspace(-0.08, 0.08, 5)
    x, y = np.meshgrid(tangents, tangents)
    rays = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1) @ axis.T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    eyes = np.broadcast_to(still.eye_w.astype(np.float32), rays.shape)
    hits = caster.cast(eyes, rays.astype(np.float32), still.t_s)
    struck = hits.triangle[hits.triangle != NO_TRIANGLE]
    part = blade_names(trial.scene.stop_angle_deg).index(still.command.blade)
    return bool((caster.mesh.part[struck] == part).any())


def caster_of(trial: Trial) -> Raycaster:
    """Return the true world of a trial."""
    return Raycaster(trial.scene, trial.settings)
