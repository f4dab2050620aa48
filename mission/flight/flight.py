"""What the mission remembers between ticks, and what a phase decides: shared by all phases."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from config.settings import Settings
from config.turbine import Site, Turbine
from mission.flight.command import (
    Action,
    GimbalAim,
    MissionState,
    Phase,
    PhotoCommand,
    SensingMode,
    SensingTask,
    Setpoint,
)
from mission.flight.earlier import Earlier
from mission.flight.events import Event, EventRecord, Reaction
from mission.flight.guard import Airspace
from mission.flight.ledger import Ledger
from mission.flight.observation import (
    BladeEstimate,
    Observation,
    Request,
    RotorEstimate,
    Vec3,
    Vehicle,
)
from mission.flight.plan import Plan
from mission.flight.rotor_model import RotorModel
from mission.flight.seen_space import SeenSpace
from mission.flight.trajectory import Follower, Path
from perception.geometry import rotation_from_quaternion, vec3
from perception.values import Float

#: Kept outside the closed sphere, for the vehicle's own wander.
SPHERE_MARGIN_M = 2.0
CORRIDOR_STEP_M = 1.5
#: A home that the autopilot reports farther than this from where it was has moved (a vessel).
HOME_MOVED_M = 3.0
#: Between two notes of where the LiDAR looks.
LOOK_S = 0.19


@dataclass(frozen=True, slots=True)
class Intent:
    """What a phase wants done at a tick."""

    words: str
    setpoint: Setpoint | None = None
    action: Action | None = None
    gimbal: GimbalAim | None = None
    ev: float | None = None
    photo: PhotoCommand | None = None
    takeoff_height_m: float | None = None
    then: PhaseStep | None = None
    """The phase of the next tick; None: this one goes on."""
    metre: float | None = None
    distance_m: float | None = None


class PhaseStep(Protocol):
    """A phase: decides a tick, and finds its way again after an interruption."""

    @property
    def phase(self) -> Phase:
        """The phase shown to the operator."""
        ...

    def step(self, flight: Flight, /) -> Intent:
        """Decide one tick."""
        ...

    def resume(self, flight: Flight, /) -> None:
        """Go on after a hold, from wherever the vehicle is."""
        ...


class Flight:
    """The mission's memory. Phases read and write it; nothing in it does I/O."""

    def __init__(self, settings: Settings, site: Site, turbine: Turbine) -> None:
        self.settings = settings
        self.site = site
        self.turbine = turbine
        self.follower = Follower(settings.airframe, settings.guard.max_lead_m)
        self.observation = Observation(now_s=0.0, tick=-1)
        self.dt_s = 0.05
        self.request: Request | None = None
        self.earlier: Earlier | None = None
        """What earlier flights of the same inspection left behind."""
        self.named_deg: float | None = None
        """The stop angle by which the blades were named, when the rotor was measured first."""
        self.home_w: Vec3 | None = None
        self.rendezvous_w: Vec3 | None = None
        """Where a vehicle that was taken over in the air is handed back, hovering."""
        self.state = MissionState.IDLE
        self.outcome: MissionState | None = None
        """How the mission will have ended once it is landed; None: completed."""
        self.outcome_words = ""
        self.swap = False
        """The energy ended this flight: with a fresh battery another one can go on."""
        self.engaged = False
        """The autopilot was seen in OFFBOARD at our asking, and we have not left it."""
        self.engaged_s = math.inf
        self.land_asked_s = -math.inf
        """When landing was asked for without having been in offboard."""
        self.rotor: RotorEstimate | None = None
        self.model: RotorModel | None = None
        self.plan: Plan | None = None
        self.iterations = 0
        self.leg_index = 0
        self.on_leg = False
        """On the line of a leg: what the LiDAR tells of the blade, it sees squarely."""
        self.ledger = Ledger()
        self.task = SensingTask(SensingMode.IDLE, 0)
        self.records: list[EventRecord] = []
        self.raised: set[Event] = set()
        """Events that a phase found itself; the watch reads them."""
        self.rotor_open = False
        self.seen = SeenSpace(settings.lidar)
        self._looked_s = -math.inf
        self.corridor_w: Float = np.zeros((0, 3))
        self.drift_w: Float = np.zeros(3)
        """(3,) of the vehicle's position since the rotor was measured, as blades have shown it."""
        self._lines: list[Float] = []

    @property
    def now_s(self) -> float:
        """Mission time of this tick."""
        return self.observation.now_s

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle; phases that fly are stepped only while it is known."""
        if self.observation.vehicle is None:
            raise RuntimeError("a flying phase was stepped without a vehicle")
        return self.observation.vehicle

    @property
    def here_w(self) -> Float:
        """Position (3,) of the vehicle."""
        return np.array(self.vehicle.position_w)

    def note(self, name: str, text: str, severity: Reaction = Reaction.NONE) -> None:
        """Write a line into the event log."""
        self.records.append(EventRecord(self.now_s, name, severity, text))

    @property
    def goal_w(self) -> Vec3:
        """Where this flight ends: the rendezvous; else home, where that is by now."""
        if self.rendezvous_w is not None:
            return self.rendezvous_w
        now, then = self.vehicle.home_w, self.home_w
        if now is not None and then is not None and math.dist(now, then) > HOME_MOVED_M:
            return now
        return then or self.vehicle.position_w

    # --- where the turbine is -------------------------------------------------------------

    @property
    def tower_w(self) -> Float:
        """(3,) the tower's base: as found, else as told."""
        home = np.zeros(3) if self.home_w is None else np.array(self.home_w)
        site = self.site
        told: Float = home + np.array([site.tower_east_m, site.tower_north_m, site.tower_up_m])
        prior = self.observation.hub_prior
        if prior is None:
            return told
        axis = np.array(prior.tower_axis_w)
        found = np.array(prior.tower_w)
        base: Float = found + axis * ((told[2] - found[2]) / axis[2])
        return base

    @property
    def tower_known(self) -> bool:
        """Whether the tower has been seen."""
        return self.observation.hub_prior is not None

    @property
    def hub_w(self) -> Float:
        """(3,) hub as measured; else as found in the ascent; else above the told tower."""
        if self.rotor is not None:
            return np.array(self.rotor.hub_w)
        prior = self.observation.hub_prior
        if prior is not None and prior.hub_w is not None:
            return np.array(prior.hub_w)
        above: Float = self.tower_w + np.array([0.0, 0.0, self.turbine.hub_height_m])
        return above

    @property
    def normal_w(self) -> Float | None:
        """(3,) unit, downwind, as far as it is known."""
        if self.rotor is not None:
            return np.array(self.rotor.normal_w)
        prior = self.observation.hub_prior
        return None if prior is None or prior.normal_w is None else np.array(prior.normal_w)

    @property
    def sphere_radius_m(self) -> float:
        """Radius of the closed sphere round the prior hub."""
        return self.turbine.rotor_radius_m + self.settings.guard.closed_sphere_margin_m

    @property
    def clear_radius_m(self) -> float:
        """Radius round the hub at which one flies outside the sphere."""
        sigma = 1.0
        if not self.tower_known:
            sigma = self.site.position_sigma_m
        elif self.observation.hub_prior is not None and self.rotor is None:
            sigma = min(max(self.observation.hub_prior.sigma_m, 0.5), 5.0)
        return self.sphere_radius_m + SPHERE_MARGIN_M + sigma

    @property
    def ground_m(self) -> float:
        """Height (z) of the ground at the turbine."""
        return float(self.tower_w[2])

    def airspace(self) -> Airspace:
        """Return what the guard has to know."""
        started = self.home_w is not None
        return Airspace(
            sphere_w=self.hub_w + self.drift_w if started else None,
            sphere_radius_m=self.sphere_radius_m,
            open=self.rotor_open,
            model=self.model,
            corridor_w=self.corridor_w,
            home_w=self.home_w,
            seen=self.seen if self.model is None else None,
            drift_w=self.drift_w,
        )

    def look(self) -> None:
        """Note where the LiDAR looks at this tick, while its scans are fresh."""
        clearance, vehicle = self.observation.clearance, self.observation.vehicle
        if clearance is None or vehicle is None or self.home_w is None:
            return
        fresh = self.now_s - clearance.stamp_s < self.settings.guard.scan_hold_s
        if fresh and self.now_s - self._looked_s > LOOK_S and np.isfinite(self.here_w).all():
            self._looked_s = self.now_s
            self.seen.look(self.here_w, vehicle.quaternion_wb)

    def open_corridor(self, lines: Sequence[Float]) -> None:
        """Open the lines (K, 3) of a plan, and those flown from now on."""
        self._lines = [_dense(line) for line in lines]
        self.corridor_w = np.concatenate(self._lines) if self._lines else np.zeros((0, 3))

    # --- moving ---------------------------------------------------------------------------

    def go(
        self,
        points_w: Sequence[Float] | Float,
        speed_mps: float | Float,
        shift_w: Float | None = None,
    ) -> None:
        """Follow a polyline from where the vehicle is; it is opened as a corridor.

        ``speed_mps``: one cap, or one for each of the points. ``shift_w``: (3,) by which the
        polyline will be moved when it is followed.
        """
        here = self.here_w if shift_w is None else self.here_w - shift_w
        points = np.concatenate([here[None], np.atleast_2d(np.asarray(points_w))])
        caps = np.atleast_1d(np.asarray(speed_mps, float))
        if len(caps) > 1:
            caps = np.concatenate([caps[:1], caps])
        caps = np.broadcast_to(caps, (len(points),))
        self.follower.start(Path(points, caps, self.settings.airframe))
        self.corridor_w = np.concatenate([*self._lines, self._clear(_dense(points))])

    def _clear(self, places_w: Float) -> Float:
        """Return those of the places (N, 3) that the model finds clear: no others are opened."""
        if self.model is None:
            return places_w
        least = self.settings.guard.min_clearance_m + self.settings.airframe.radius_m
        clear: Float = places_w[self.model.distance(places_w) >= least]
        return clear

    def follow(
        self,
        yaw_rad: float,
        slow: float = 1.0,
        shift_w: Float | None = None,
        *,
        firm: bool | None = None,
    ) -> Setpoint:
        """Return the next setpoint along the path that `go` began.

        ``firm``: gusts shall not push the vehicle off the line; True where the LiDAR sees that
        line, False where only the position tells it, whose noise is let be. None: far from all.
        """
        scan_rate = self._scan_rate_hz()
        # Travel per scan stays below 0.2 m near the turbine, whatever the scan rate.
        if scan_rate < 10.0 and self.model is not None:
            slow *= max(0.2, scan_rate / 10.0)
        return self.follower.follow(
            self.vehicle.position_w, yaw_rad, self.dt_s, slow=slow, shift_w=shift_w,
            velocity_w=None if firm is None else self.vehicle.velocity_w, slack=firm is False,
        )  # fmt: skip

    def hold(self, yaw_rad: float | None = None) -> Setpoint:
        """Return a setpoint that stays here."""
        yaw = self.vehicle.yaw_rad if yaw_rad is None else yaw_rad
        return self.follower.hold(self.vehicle.position_w, yaw, self.dt_s)

    def arrived(self, within_m: float = 0.6, shift_w: Float | None = None) -> bool:
        """Return whether the vehicle is at the end of its path, moved by ``shift_w``."""
        here = self.here_w if shift_w is None else self.here_w - shift_w
        return self.follower.arrived(vec3(here), within_m)

    def yaw_to(self, place_w: Float) -> float:
        """Return the yaw that faces a place; the present one where it is straight above."""
        offset = place_w - self.here_w
        if math.hypot(offset[0], offset[1]) < 1.0:
            return self.vehicle.yaw_rad
        return math.atan2(offset[1], offset[0])

    def aim_at(self, place_w: Float) -> GimbalAim:
        """Return the gimbal angles that point the camera at a place."""
        # The airframe leans into the wind, and the camera's arm with it.
        body = rotation_from_quaternion(self.vehicle.quaternion_wb)
        eye = self.here_w + body @ np.array(self.settings.camera.offset_m)
        dx, dy, dz = (float(d) for d in place_w - eye)
        flat = math.hypot(dx, dy)
        yaw = math.atan2(dy, dx) if flat > 0.5 else self.vehicle.yaw_rad
        pitch = math.degrees(math.atan2(dz, flat))
        gimbal = self.settings.gimbal
        pitch = min(max(pitch, gimbal.min_pitch_deg), gimbal.max_pitch_deg)
        return GimbalAim(yaw, math.radians(pitch))

    def _scan_rate_hz(self) -> float:
        clearance = self.observation.clearance
        return 10.0 if clearance is None else clearance.scan_rate_hz

    # --- sensing --------------------------------------------------------------------------

    def sense(self, mode: SensingMode, *, new: bool = False) -> None:
        """Set what sensing computes; ``new`` clears what it has accumulated."""
        if mode is self.task.mode and not new:
            return
        normal = self.normal_w
        self.task = SensingTask(
            mode=mode,
            task_id=self.task.task_id + 1,
            tower_w=vec3(self.tower_w),
            hub_w=vec3(self.hub_w),
            normal_w=None if normal is None else vec3(normal),
            turbine=self.site.name,
        )

    def sense_blade(
        self,
        blade: str,
        side: str,
        root_w: Float,
        tip_w: Float,
        half_width_m: float,
        *,
        blind: bool = False,
    ) -> None:
        """Let sensing find the blade near its modelled axis; ``blind``: only the camera sees it."""
        self.task = SensingTask(
            mode=SensingMode.BLADE,
            task_id=self.task.task_id + 1,
            tower_w=vec3(self.tower_w),
            hub_w=vec3(self.hub_w),
            normal_w=None if self.rotor is None else self.rotor.normal_w,
            turbine=self.site.name,
            blade=blade,
            side=side,
            blade_root_w=vec3(root_w),
            blade_tip_w=vec3(tip_w),
            half_width_m=half_width_m,
            blind=blind,
            others=() if self.model is None else self.model.beside(blade),
            blades=self._blades(),
            measured_s=None if self.rotor is None else self.rotor.stamp_s,
        )

    def _blades(self) -> tuple[BladeEstimate, ...]:
        """Return the blades of the model."""
        frames = () if self.model is None else self.model.frames
        return tuple(
            BladeEstimate(frame.name, vec3(frame.axis_w), math.degrees(frame.pitch_rad))
            for frame in frames
            if frame.pitch_rad is not None
        )


def _dense(line: Float) -> Float:
    """Return a polyline resampled about every metre and a half."""
    pieces = np.linalg.norm(np.diff(line, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(pieces)])
    even = np.linspace(0.0, at[-1], max(2, math.ceil(at[-1] / CORRIDOR_STEP_M) + 1))
    return np.stack([np.interp(even, at, line[:, k]) for k in range(3)], axis=1)
