"""A whole mission in a second: machine and guard against a kinematic vehicle and ideal senses.

No process, no clock, no I/O: time is counted. The vehicle follows setpoints as PX4 was measured to
(0.5-0.7 m of lag at 1.5-2 m/s); what sensing would say is derived from a true rotor, with noise
where asked for. Tests fly with it, and benchmarks time the tick with it.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from benchmarks.virtual_turbine import Truth, surface, true_model
from config.settings import Settings
from config.turbine import Site, Turbine
from mission.flight.command import Action, Command, MissionState, Phase, PhotoCommand, SensingMode
from mission.flight.events import EventRecord
from mission.flight.guard import Guard, GuardedCommand, Surroundings
from mission.flight.machine import Machine
from mission.flight.observation import (
    BladeEstimate,
    BladeTrack,
    CameraState,
    ClearanceState,
    ExposureState,
    FlightMode,
    GimbalState,
    HubPrior,
    Observation,
    Request,
    RequestKind,
    RotorEstimate,
    Vec3,
    Vehicle,
)
from mission.flight.section import Section
from mission.flight.sides import BladeFrame
from perception.geometry import vec3, wrap_angle
from perception.values import Float

TICK_S = 0.05
POSITION_GAIN = 0.95
#: Of the velocity fed forward the vehicle realises this much at once; the rest is lag.
FEED_SHARE = 0.67
VELOCITY_LAG_S = 0.3
MODE_REPORT_S = 1.0
SEEN_FROM_M = 65.0
TERMINAL = frozenset(
    {
        MissionState.COMPLETED,
        MissionState.ENDED_SAFELY,
        MissionState.REFUSED,
        MissionState.FAILED,
        MissionState.RELEASED,
    }
)


@dataclass(slots=True)
class Flown:
    """What came of a virtual mission."""

    machine: Machine
    duration_s: float
    commands: int
    min_clearance_m: float
    """Of the airframe's outermost point to the true model, in the air near the turbine."""
    photos: list[PhotoCommand]
    events: list[EventRecord]
    refusals: list[tuple[float, str]]
    track: list[Vec3]
    step_s: list[float]
    guard_s: list[float]
    phases: list[Phase]


Hook = Callable[["VirtualFlight", Observation], Observation]


@dataclass
class VirtualFlight:
    """The world round a machine; ``hook`` may change what the machine is told (faults)."""

    settings: Settings
    site: Site
    turbine: Turbine
    truth: Truth = field(default_factory=Truth)
    hook: Hook | None = None
    seed: int = 1
    timed: bool = False
    machine: Machine = field(init=False)
    now_s: float = 100.0
    tick: int = 0
    position: Float = field(default_factory=lambda: np.zeros(3))
    velocity: Float = field(default_factory=lambda: np.zeros(3))
    yaw: float = 0.0
    mode: FlightMode = FlightMode.HOLD
    armed: bool = False
    requests: list[Request] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Place vehicle, turbine and senses."""
        self.machine = Machine(self.settings, self.site, self.turbine)
        self._guard = Guard(self.settings)
        self._model = true_model(self.truth, self.turbine)
        self._points = surface(self._model, self.turbine)
        self._rng = np.random.default_rng(self.seed)
        self._battery = 1.0
        self._mode_reported = (self.mode, self.now_s)
        self._mode_due_s = self.now_s
        self._gimbal = (0.0, 0.0)
        self._ev = 0.0
        self._photo: tuple[int, float] | None = None
        self._last_photo = -1
        self._climb_to: float | None = None
        self._task_id, self._task_s = -1, 0.0
        self._sequence = 0
        self._rotor: RotorEstimate | None = None
        self._track: BladeTrack | None = None
        self._prior: HubPrior | None = None
        self._clearance: ClearanceState | None = None
        self._surroundings = Surroundings(np.zeros((0, 3)), self.now_s)
        self._previous: GuardedCommand | None = None

    # --- the loop -------------------------------------------------------------------------

    def start(self, **changes: object) -> None:
        """Ask for the mission."""
        request = Request(RequestKind.START, "1", self.site.name, "test", rotor_locked=True)
        self.requests.append(dataclasses.replace(request, **changes))  # type: ignore[arg-type] # field values by name

    def ask(self, kind: RequestKind) -> None:
        """Send another request with the next tick."""
        self.requests.append(Request(kind, f"{self.tick}", operator="test"))

    def run(self, limit_s: float = 2000.0, until: Phase | None = None) -> Flown:
        """Fly until the mission has ended (or a phase is reached, or the limit)."""
        flown = Flown(self.machine, 0.0, 0, math.inf, [], [], [], [], [], [], [])
        begun = self.now_s
        while self.now_s - begun < limit_s:
            guarded = self.one_tick(flown)
            state = guarded.command.progress.state
            if state in TERMINAL or guarded.command.progress.phase is until:
                break
        flown.duration_s = self.now_s - begun
        return flown

    def one_tick(self, flown: Flown) -> GuardedCommand:
        """Advance the world by a tick, let machine and guard decide, obey."""
        self.now_s += TICK_S
        self.tick += 1
        observation = self._observe()
        if self.hook is not None:
            observation = self.hook(self, observation)
        t0 = time.perf_counter()
        command, events = self.machine.step(observation)
        t1 = time.perf_counter()
        before = None if self._previous is None else self._previous.command.setpoint
        guarded = self._guard.check(
            command, observation, self._surroundings, self.machine.airspace(), before
        )
        t2 = time.perf_counter()
        self._previous = guarded
        self._obey(guarded.command)
        self._write(flown, guarded, events, t1 - t0, t2 - t1)
        return guarded

    def _write(
        self,
        flown: Flown,
        guarded: GuardedCommand,
        events: tuple[EventRecord, ...],
        step_s: float,
        guard_s: float,
    ) -> None:
        flown.commands += 1
        flown.events.extend(events)
        if guarded.command.photo is not None:
            flown.photos.append(guarded.command.photo)
        if guarded.refused:
            flown.refusals.append((self.now_s, guarded.reason))
        if not flown.phases or flown.phases[-1] is not guarded.command.progress.phase:
            flown.phases.append(guarded.command.progress.phase)
        if self.timed:
            flown.step_s.append(step_s)
            flown.guard_s.append(guard_s)
        if self.tick % 4 == 0:
            flown.track.append(vec3(self.position))
            if self.position[2] > 5.0:
                distance = float(self._model.distance(self.position[None])[0])
                clearance = distance - self.settings.airframe.radius_m
                flown.min_clearance_m = min(flown.min_clearance_m, clearance)

    # --- the vehicle ----------------------------------------------------------------------

    def pilot_takes(self) -> None:
        """The pilot switches to a mode of his own; reports of it follow at 1 Hz."""
        self.mode = FlightMode.PILOT

    def _obey(self, command: Command) -> None:
        self._act(command)
        setpoint = command.setpoint
        wanted: Float = np.zeros(3, np.float64)
        if self.mode is FlightMode.OFFBOARD and setpoint is not None:
            lead = np.array(setpoint.position_w) - self.position
            wanted = POSITION_GAIN * lead + FEED_SHARE * np.array(setpoint.velocity_w)
            turn = wrap_angle(setpoint.yaw_rad - self.yaw)
            self.yaw = wrap_angle(self.yaw + min(max(turn, -0.04), 0.04))
        elif self.mode is FlightMode.TAKEOFF and self._climb_to is not None:
            rise = self._climb_to - self.position[2]
            wanted = np.array([0.0, 0.0, min(1.5, rise)])
            if rise < 0.2:
                self.mode = FlightMode.HOLD
        elif self.mode is FlightMode.LAND:
            wanted = np.array([0.0, 0.0, -1.5])
        if not self.armed:
            return
        share = TICK_S / VELOCITY_LAG_S
        self.velocity = self.velocity + share * (wanted - self.velocity)
        self.position = self.position + TICK_S * self.velocity
        self._battery -= TICK_S / 2000.0
        if self.position[2] <= 0.0:
            self.position[2] = 0.0
            self.velocity = np.zeros(3)
            if self.mode is FlightMode.LAND:
                self.armed = False

    def _act(self, command: Command) -> None:
        action = command.action
        if action is Action.ARM:
            self.armed = True
        elif action is Action.DISARM:
            self.armed = False
        elif action is Action.TAKEOFF:
            self.mode = FlightMode.TAKEOFF
            self._climb_to = self.position[2] + (command.takeoff_height_m or 0.0)
        elif action is Action.OFFBOARD and command.setpoint is not None:
            self.mode = FlightMode.OFFBOARD
        elif action is Action.HOLD:
            self.mode = FlightMode.HOLD
        elif action is Action.LAND:
            self.mode = FlightMode.LAND
        if command.gimbal is not None:
            # First order, half a second: the aim is late while it moves.
            yaw, pitch = self._gimbal
            share = TICK_S / 0.25
            yaw += share * wrap_angle(command.gimbal.yaw_rad - yaw)
            self._gimbal = (wrap_angle(yaw), pitch + share * (command.gimbal.pitch_rad - pitch))
        if command.ev is not None:
            self._ev = command.ev
        if command.photo is not None:
            self._photo = (command.photo.photo_id, self.now_s)
        if self._photo is not None and self.now_s - self._photo[1] > 0.4:
            self._last_photo, self._photo = self._photo[0], None
        task = command.sensing
        if task.task_id != self._task_id:
            self._task_id, self._task_s = task.task_id, self.now_s
            self._track = None
        if self.tick % 2 == 0:
            self._sense(command)

    # --- the senses -----------------------------------------------------------------------

    def _sense(self, command: Command) -> None:
        task, model = command.sensing, self._model
        apart = np.linalg.norm(self._points - self.position, axis=1)
        nearest = int(apart.argmin())
        near = apart[nearest] < 60.0
        self._clearance = ClearanceState(
            self.now_s,
            self.tick,
            float(apart[nearest]) if near else None,
            vec3(self._points[nearest]) if near else None,
        )
        self._surroundings = Surroundings(self._points[apart < 30.0], self.now_s)
        if task.mode is SensingMode.TOWER and (self.tick % 10 == 0 or self._prior is None):
            self._survey()
        if task.mode is SensingMode.ROTOR:
            accumulate = self.settings.estimation.accumulate_s
            since = max(self._task_s, -math.inf if self._rotor is None else self._rotor.stamp_s)
            if self.now_s - since >= accumulate:
                self._measure()
        frames = {frame.name: frame for frame in model.frames}
        if task.mode is SensingMode.BLADE and task.blade in frames:
            self._follow(frames[task.blade])

    def _survey(self) -> None:
        tower = np.array(self.truth.tower_w)
        offset = self.position - tower
        seen_from_m = max(SEEN_FROM_M, self.turbine.rotor_radius_m + 20.0)
        if math.hypot(offset[0], offset[1]) > seen_from_m or self.position[2] < 5.0:
            return
        model = self._model
        high = self.position[2] > 0.6 * self.turbine.hub_height_m
        level = np.array([model.normal_w[0], model.normal_w[1], 0.0])
        level /= np.linalg.norm(level)
        cosine = abs(float(offset @ level)) / max(math.hypot(offset[0], offset[1]), 1e-6)
        off = math.degrees(math.acos(min(1.0, cosine)))
        known = high and off <= self.truth.side_known_within_deg
        remembered = self._prior is not None and self._prior.normal_w is not None
        told = known or remembered
        self._prior = HubPrior(
            stamp_s=self.now_s,
            tower_w=vec3(tower + np.array([0.0, 0.0, 5.0])),
            tower_axis_w=(0.0, 0.0, 1.0),
            tower_top_m=self.turbine.tower_height_m if high else None,
            hub_w=vec3(model.hub_w + self._rng.normal(0, 0.5, 3)) if told else None,
            normal_w=vec3(level) if told else None,
            sigma_m=1.0 if high else 2.0,
            turning=self.truth.turning if told and self._sees_blades() else None,
        )

    def _sees_blades(self) -> bool:
        within_m = self.truth.still_seen_within_m
        if not math.isfinite(within_m):
            return True
        metres = np.linspace(0.0, self._model.frames[0].length_m, 30)
        points = [f.root_w + metres[:, None] * f.axis_w for f in self._model.frames]
        apart = np.linalg.norm(np.concatenate(points) - self.position, axis=1)
        return bool(apart.min() < within_m)

    def _measure(self) -> None:
        self._sequence += 1
        noise = float(self._rng.normal(0, self.truth.angle_noise_deg))
        model = self._model
        self._rotor = RotorEstimate(
            stamp_s=self.now_s,
            sequence=self._sequence,
            hub_w=vec3(model.hub_w + self._rng.normal(0, self.truth.angle_noise_deg, 3)),
            normal_w=vec3(model.normal_w),
            stop_angle_deg=(self.truth.stop_angle_deg + noise) % 120.0,
            sigma_deg=self.truth.sigma_deg or self.truth.angle_noise_deg,
            blades=tuple(
                BladeEstimate(
                    frame.name,
                    vec3(frame.axis_w),
                    self.truth.pitch_deg if self.truth.pitch_known else None,
                )
                for frame in model.frames
            ),
            method="virtual",
        )

    def _follow(self, frame: BladeFrame) -> None:
        along = float((self.position - frame.root_w) @ frame.axis_w)
        along = min(max(along, 0.0), frame.length_m)
        foot = frame.root_w + along * frame.axis_w
        view = self.position - foot
        view = view / max(float(np.linalg.norm(view)), 1e-6)
        middle = Section(frame, self.turbine, np.array([along])).centre(view)[0]
        foot = foot + middle
        self._track = BladeTrack(
            stamp_s=self.now_s,
            blade=frame.name,
            foot_w=vec3(foot),
            direction_w=vec3(frame.axis_w),
            distance_m=float(np.linalg.norm(self.position - foot)),
            points_per_s=500.0,
            offset_w=vec3(middle + self._rng.normal(0, 0.05, 3)),
            residual_m=0.05,
        )

    def _observe(self) -> Observation:
        if self.now_s >= self._mode_due_s:
            self._mode_due_s = self.now_s + MODE_REPORT_S
            self._mode_reported = (self.mode, self.now_s)
        noise = self._rng.normal(0, self.truth.position_noise_m, 3)
        airborne = self.armed and bool(self.position[2] > 0.3)
        vehicle = Vehicle(
            stamp_s=self.now_s,
            position_w=vec3(self.position + noise),
            velocity_w=vec3(self.velocity),
            quaternion_wb=(math.cos(self.yaw / 2), 0.0, 0.0, math.sin(self.yaw / 2)),
            yaw_rad=self.yaw,
            mode=self._mode_reported[0],
            mode_stamp_s=self._mode_reported[1],
            armed=self.armed,
            in_air=airborne,
            landed=not airborne,
            heartbeat_stamp_s=self.now_s,
            battery=self._battery,
            battery_stamp_s=self.now_s,
            home_w=(0.0, 0.0, 0.0),
        )
        requests, self.requests = tuple(self.requests), []
        refused = self._previous is not None and self._previous.refused
        reason = self._previous.reason if refused and self._previous is not None else ""
        return Observation(
            now_s=self.now_s,
            tick=self.tick,
            vehicle=vehicle,
            gimbal=GimbalState(self.now_s, *self._gimbal),
            camera=CameraState(self.now_s, self._ev, self.now_s, last_photo_id=self._last_photo),
            clearance=self._clearance or ClearanceState(self.now_s, 0, None, None),
            hub_prior=self._prior,
            rotor=self._rotor,
            blade=self._track,
            exposure=ExposureState(self.now_s, 135.0, True, 0.0),
            requests=requests,
            guard_refused=reason,
        )
