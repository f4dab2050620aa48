"""What perception tells the flight in the tracking bench.

Clearance, occupancy and the blade's line are computed by the product's own code from thin scans of
the true mesh. Tower and rotor are told as the angle bench measures them: true, with errors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from benchmarks.tracking_lidar import BodyPose, ThinLidar
from benchmarks.tracking_trials import Trial
from drivers.simulated.aircraft import Aircraft
from drivers.simulated.blade_mesh import axis_points
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.rotor_frame import BladeFrame, blade_names, rotor_frame
from mission.flight.command import SensingMode, SensingTask
from mission.flight.guard import NOTHING_AROUND, Surroundings
from mission.flight.observation import (
    BladeEstimate,
    BladeTrack,
    ClearanceState,
    HubPrior,
    RotorEstimate,
)
from mission.processes.blade_follower import BladeFollower, followed, kept_s
from perception.clearance import OccupancyMemory
from perception.geometry import rotation_from_euler, rotation_from_quaternion, vec3
from perception.values import Float

#: Errors of one measured rotor: `bladescout bench angle` (mean 0.18 deg: sigma 0.23).
ANGLE_SIGMA_DEG = 0.23
HUB_SIGMA_M = 0.08
NORMAL_SIGMA_DEG = 0.25
PITCH_SIGMA_DEG = 1.0
_JITTER = 0.25
_AROUND_M, _AROUND_POINTS, _REACH_M = 30.0, 1500, 45.0
_SEEN_M = 65.0
#: Of a blade that is farther away, too few points come back to tell whether it moves.
_BLADE_SEEN_M = 55.0
_STATIONS = 120


@dataclass(frozen=True, slots=True, eq=False)
class TrueBlade:
    """One blade as it really hangs, in the scene's world."""

    name: str
    frame: BladeFrame
    root_w: Float
    """(3,) on the undeflected pitch axis: metre 0."""
    metres: Float
    """(S,)"""
    centres_w: Float
    """(S, 3) deflected pitch axis."""

    def at(self, metre: float) -> Float:
        """Return the point (3,) of the deflected axis at a metre."""
        return np.array([np.interp(metre, self.metres, self.centres_w[:, k]) for k in range(3)])

    def beside(self, place_w: Float) -> tuple[float, Float]:
        """Return metre and point (3,) of the deflected axis that are nearest to a place."""
        along = np.diff(self.centres_w, axis=0)
        starts = self.centres_w[:-1]
        share = np.einsum("ij,ij->i", place_w - starts, along) / np.einsum("ij,ij->i", along, along)
        share = np.clip(share, 0.0, 1.0)
        points = starts + share[:, None] * along
        k = int(np.linalg.norm(points - place_w, axis=1).argmin())
        metre = self.metres[k] + share[k] * (self.metres[k + 1] - self.metres[k])
        return float(metre), points[k]


def true_blades(trial: Trial) -> dict[str, TrueBlade]:
    """Return the blades of a trial by their names."""
    scene, frame = trial.scene, rotor_frame(trial.scene)
    span: Float = np.linspace(0.0, 1.0, _STATIONS, dtype=np.float64)
    turbine = scene.turbine
    blades = {}
    for name, blade in zip(blade_names(scene.stop_angle_deg), frame.blades, strict=True):
        centres = frame.hub_w + axis_points(turbine, blade, span)
        root = frame.hub_w + turbine.hub_radius_m * blade.axis_w
        blades[name] = TrueBlade(name, blade, root, span * turbine.blade_length_m, centres)
    return blades


class Senses:
    """The newest of everything that perception would have published."""

    def __init__(self, trial: Trial, aircraft: Aircraft, caster: Raycaster) -> None:
        settings = trial.settings
        self._trial, self._aircraft = trial, aircraft
        self._launch_w = np.asarray(trial.scene.launch_w)
        self._frame = rotor_frame(trial.scene)
        self.blades = true_blades(trial)
        self._lines = _lines(trial, self.blades)
        seed = settings.simulation.seed
        self._lidar = ThinLidar(caster, settings.lidar, seed)
        self._follower = BladeFollower(
            {settings.sites[0].name: trial.turbine}, settings.positioning
        )
        ignore_m = settings.lidar.blind_range_m + settings.airframe.radius_m
        self._memory = OccupancyMemory(ignore_within_m=ignore_m)
        self._rng = np.random.default_rng([seed, 0x5E])
        self._bias = self._rng.standard_normal(9)
        self._task = SensingTask(SensingMode.IDLE, 0)
        self._task_s = 0.0
        self._scans = 0
        self.clearance: ClearanceState | None = None
        self.surroundings: Surroundings = NOTHING_AROUND
        self.prior: HubPrior | None = None
        self.rotor: RotorEstimate | None = None
        self.blade: BladeTrack | None = None

    def task(self, task: SensingTask, now_s: float) -> None:
        """Take the flight's task."""
        if task.task_id != self._task.task_id:
            self._task_s, self.blade = now_s, None
        self._task = task

    def scan(self, now_s: float) -> None:
        """Take one scan, and tell what follows from it."""
        aircraft, task = self._aircraft, self._task
        telemetry = aircraft.telemetry
        here = np.asarray(telemetry.position_l)
        true = BodyPose(
            np.asarray(aircraft.body.position_w), rotation_from_quaternion(aircraft.quaternion_wb)
        )
        believed = BodyPose(here, rotation_from_quaternion(telemetry.quaternion_lb))
        blade = self.blades.get(task.blade) if task.mode is SensingMode.BLADE else None
        beside: tuple[Float, Float] | None = None
        others: tuple[tuple[Float, Float], ...] = ()
        if blade is not None:
            beside = (blade.beside(true.position)[1], blade.frame.axis_w)
            others = tuple(line for name, line in self._lines.items() if name != blade.name)
        points = self._lidar.scan(true, believed, beside, others)
        self._scans += 1
        self._clear(points, here, now_s)
        if blade is not None:
            velocity = np.asarray(telemetry.velocity_l)
            track = self._follower.follow(task, points, now_s, here, velocity)
            self.blade = track or self.blade
        elif task.mode is SensingMode.TOWER and self._scans % 5 == 0:
            self._survey(now_s)
        elif task.mode is SensingMode.ROTOR:
            since = max(self._task_s, -math.inf if self.rotor is None else self.rotor.stamp_s)
            if now_s - since >= self._trial.settings.estimation.accumulate_s:
                self._measure(now_s)

    def _clear(self, points: Float, here: Float, now_s: float) -> None:
        near = np.linalg.norm(points - here, axis=1) < _REACH_M
        self._memory.update(points[near], now_s, here)
        nearest = self._memory.nearest(here)
        self.clearance = ClearanceState(
            now_s,
            self._scans,
            None if nearest is None else nearest[0],
            None if nearest is None else vec3(nearest[1]),
        )
        if self._scans % 2:
            return
        around = self._memory.around(
            here, _AROUND_M, _AROUND_POINTS,
            not_before_s=now_s - kept_s(self._trial.settings.positioning),
            followed=followed(self._task, now_s),
        )  # fmt: skip
        self.surroundings = Surroundings(around.astype(np.float64), now_s)

    def _local(self, place_w: Float) -> Float:
        """Return a true place (3,) as it lies in the frame that the autopilot believes now."""
        return np.asarray(
            place_w - self._launch_w + np.asarray(self._aircraft.error.position), np.float64
        )

    def _survey(self, now_s: float) -> None:
        body, turbine = self._aircraft.body, self._trial.turbine
        if math.hypot(body.x, body.y) > max(_SEEN_M, turbine.rotor_radius_m + 20.0):
            return
        if body.z - self._launch_w[2] < 5.0:
            return
        high = body.z > 0.6 * turbine.hub_height_m
        level = -self._frame.upwind_level_w
        tower = self._local(np.array([0.0, 0.0, 5.0]))
        hub = self._local(self._frame.hub_w) + 0.5 * self._bias[:3]
        known = high or (self.prior is not None and self.prior.normal_w is not None)
        here = np.array([body.x, body.y, body.z])
        near_m = min(math.dist(here, blade.beside(here)[1]) for blade in self.blades.values())
        self.prior = HubPrior(
            stamp_s=now_s,
            tower_w=vec3(tower),
            tower_axis_w=(0.0, 0.0, 1.0),
            tower_top_m=turbine.tower_height_m if high else None,
            hub_w=vec3(hub) if known else None,
            normal_w=vec3(level) if known else None,
            sigma_m=1.0 if high else 2.0,
            turning=False if known and near_m < _BLADE_SEEN_M else None,
        )

    def _measure(self, now_s: float) -> None:
        """A rotor as the fit would have it: what errs alike in each look, and a little jitter."""
        own = self._bias + _JITTER * self._rng.standard_normal(9)
        frame, scene = self._frame, self._trial.scene
        lean = rotation_from_euler(*np.deg2rad(NORMAL_SIGMA_DEG * own[3:6] * [1.0, 1.0, 1.0]))
        angle = math.radians(ANGLE_SIGMA_DEG * own[6])
        turn = _about(-frame.normal_w, angle)
        together = lean @ turn
        blades = []
        for name, blade, pitch, err in zip(
            blade_names(scene.stop_angle_deg), frame.blades, scene.pitch_deg,
            PITCH_SIGMA_DEG * (own[[7, 8, 0]]), strict=True,
        ):  # fmt: skip
            blades.append(BladeEstimate(name, vec3(together @ blade.axis_w), pitch + float(err)))
        self.rotor = RotorEstimate(
            stamp_s=now_s,
            sequence=1 if self.rotor is None else self.rotor.sequence + 1,
            hub_w=vec3(self._local(frame.hub_w) + HUB_SIGMA_M * own[:3]),
            normal_w=vec3(lean @ frame.normal_w),
            stop_angle_deg=(scene.stop_angle_deg + math.degrees(angle)) % 120.0,
            sigma_deg=ANGLE_SIGMA_DEG,
            blades=tuple(sorted(blades, key=lambda blade: blade.name)),
            cone_deg=scene.cone_deg,
            method="modelled",
        )


def _lines(trial: Trial, blades: dict[str, TrueBlade]) -> dict[str, tuple[Float, Float]]:
    """Return both ends of the axes of the blades and of the tower, truly."""
    lines = {name: (blade.centres_w[0], blade.centres_w[-1]) for name, blade in blades.items()}
    top = np.array([0.0, 0.0, trial.turbine.tower_height_m])
    lines["tower"] = (np.zeros(3), top)
    return lines


def _about(axis: Float, angle_rad: float) -> Float:
    """Return the rotation about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(
        np.eye(3) + math.sin(angle_rad) * cross + (1.0 - math.cos(angle_rad)) * (cross @ cross)
    )
