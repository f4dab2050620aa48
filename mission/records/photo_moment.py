"""What was known at the moment of a photo: gathered from the bus, as it goes by.

A photo is told when it exists at the camera, later than it was exposed. Vehicle, gimbal and blade
are therefore kept for a while and looked up, in between samples, by the photo's own time.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from pydantic import TypeAdapter

from config.photos import Positioning
from drivers.bus import Key
from mission.flight.command import SensingMode, SensingTask
from mission.flight.observation import BladeTrack, GimbalState, RotorEstimate, TurbineSeen, Vehicle
from mission.remote.messages import PhotoTakenMessage, VehicleMessage
from perception.frame_drift import SIGHTED_S, FrameDrift
from perception.geometry import rotation_from_quaternion, wrap_angle
from perception.values import Float

_TASK = TypeAdapter(SensingTask)
_ROTOR = TypeAdapter(RotorEstimate)
_BLADE = TypeAdapter(BladeTrack)

#: At 20 Hz: half a minute.
_KEPT = 600
#: A sample farther than this from the photo's time says nothing of it.
_NEAR_S = 0.3
_RATE_OVER_S = 0.06
#: The wander is slow and what the LiDAR sees of it is biased for seconds: measured this seldom.
_MEASURE_EVERY_S = 3.0
_DEPTH_SIGMA_M, _ASIDE_SIGMA_M, _TIP_SIGMA_M = 0.1, 0.4, 0.3
#: How far the measured hub is off, per axis: against the truth of thirteen flights of the demo
#: scenario it was 0.5 m along a blade.
ROTOR_SIGMA_M = 0.4
#: What photos say is as far off for seconds, by the heading's error: taken this seldom.
_SIGHT_EVERY_S = 6.0
#: What a blade bends is not wander: the farther out, the less an offset says.
_BEND_PER_METRE = 0.012
_TIPS, _TIP_SPREAD_M = 12, 0.15


@dataclass(frozen=True, slots=True, eq=False)
class BladeThen:
    """The blade that was flown along when a photo was taken. World ENU, metres."""

    hub_w: Float
    normal_w: Float
    """(3,) downwind."""
    root_w: Float
    axis_w: Float
    pitch_deg: float | None
    track: BladeTrack | None
    """As the LiDAR saw it then; None where it did not."""
    drift_w: Float
    """(3,) the vehicle's reported position less its place in the rotor's frame."""
    drift_covariance: Float
    """(3, 3)"""


@dataclass(frozen=True, slots=True, eq=False)
class PhotoMoment:
    """Vehicle, gimbal and blade at a photo's time. World ENU, metres, radians."""

    position_w: Float
    """(3,) of the body."""
    quaternion_wb: tuple[float, float, float, float]
    velocity_w: Float
    gimbal_yaw_rad: float
    gimbal_pitch_rad: float
    turning_rps: float
    """How fast the optical axis turned; NaN where that was not measured."""
    blade: BladeThen | None


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """What a picture says of how far the vehicle's reported position has wandered."""

    direction_w: Float
    """(3,) unit"""
    drift_m: float
    """In that direction."""
    sigma_m: float


def moment_of(taken: PhotoTakenMessage) -> PhotoMoment:
    """Return the moment as the photo's own message tells it, where nothing else was heard."""
    return PhotoMoment(
        position_w=np.array(taken.position_w),
        quaternion_wb=taken.quaternion_wb,
        velocity_w=np.zeros(3),
        gimbal_yaw_rad=taken.gimbal_yaw_rad,
        gimbal_pitch_rad=taken.gimbal_pitch_rad,
        turning_rps=math.nan,
        blade=None,
    )


class PhotoHistory:
    """Listens to a mission; answers what was known at a photo's time."""

    def __init__(self, positioning: Positioning) -> None:
        self._positioning = positioning
        self._vehicles: deque[Vehicle] = deque(maxlen=_KEPT)
        self._gimbals: deque[GimbalState] = deque(maxlen=_KEPT)
        self._tracks: deque[BladeTrack] = deque(maxlen=_KEPT)
        self._rotors: list[RotorEstimate] = []
        self._tasks: dict[tuple[str, str], SensingTask] = {}
        self._task: SensingTask | None = None
        self._drift: FrameDrift | None = None
        self._measured_s = self._sighted_s = self._turbine_s = -math.inf
        self._drifts: deque[tuple[float, Float, Float]] = deque(maxlen=_KEPT)
        self._tips: deque[float] = deque(maxlen=_TIPS)

    def take(self, key: str, payload: bytes) -> None:
        """Take a message of the bus; those that say nothing of photos are passed over."""
        if key == Key.VEHICLE:
            message = VehicleMessage.model_validate_json(payload)
            if message.vehicle is not None:
                self._vehicles.append(message.vehicle)
                self._take_motion(message.vehicle)
            if message.gimbal is not None:
                self._gimbals.append(message.gimbal)
        elif key == Key.TASK:
            self._take_task(_TASK.validate_json(payload))
        elif key == Key.ROTOR:
            rotor = _ROTOR.validate_json(payload)
            if rotor.refusal is None:
                self._rotors.append(rotor)
        elif key == Key.BLADE:
            self._take_track(_BLADE.validate_json(payload))

    def moment(self, taken: PhotoTakenMessage) -> PhotoMoment:
        """Return what was known when the photo was exposed."""
        told = moment_of(taken)
        t_s = taken.stamp_s
        position, velocity = self._place(t_s, told)
        yaw, pitch, turning = self._axis(t_s, told)
        nearest = self._nearest_vehicle(t_s)
        return PhotoMoment(
            position_w=position,
            quaternion_wb=told.quaternion_wb if nearest is None else nearest.quaternion_wb,
            velocity_w=velocity,
            gimbal_yaw_rad=yaw,
            gimbal_pitch_rad=pitch,
            turning_rps=turning,
            blade=self._blade(taken),
        )

    def take_sightings(self, stamp_s: float, sightings: tuple[Sighting, ...]) -> None:
        """Take what a photo says of the wander."""
        if self._drift is None or stamp_s - self._sighted_s < _SIGHT_EVERY_S:
            return
        for one in sightings:
            self._sighted_s = stamp_s
            self._drift.measure(stamp_s, one.direction_w, one.drift_m, one.sigma_m)

    # --- vehicle and gimbal -------------------------------------------------------------------

    def _nearest_vehicle(self, t_s: float) -> Vehicle | None:
        near = min(self._vehicles, key=lambda v: abs(v.stamp_s - t_s), default=None)
        return near if near is not None and abs(near.stamp_s - t_s) < _NEAR_S else None

    def _place(self, t_s: float, told: PhotoMoment) -> tuple[Float, Float]:
        near = self._nearest_vehicle(t_s)
        if near is None:
            return told.position_w, told.velocity_w
        velocity = np.array(near.velocity_w)
        return np.array(near.position_w) + (t_s - near.stamp_s) * velocity, velocity

    def _axis(self, t_s: float, told: PhotoMoment) -> tuple[float, float, float]:
        """Return yaw, pitch and rate of the optical axis, between the gimbal's samples."""
        near = [g for g in self._gimbals if abs(g.stamp_s - t_s) < _NEAR_S]
        stamps, first = np.unique([g.stamp_s for g in near], return_index=True)
        if len(stamps) < 2:
            return told.gimbal_yaw_rad, told.gimbal_pitch_rad, math.nan
        yaws = np.unwrap([near[k].yaw_rad for k in first])
        pitches = np.array([near[k].pitch_rad for k in first])

        def at(when_s: float) -> tuple[float, float]:
            return float(np.interp(when_s, stamps, yaws)), float(np.interp(when_s, stamps, pitches))

        yaw, pitch = at(t_s)
        early_s = max(t_s - _RATE_OVER_S, float(stamps[0]))
        late_s = min(t_s + _RATE_OVER_S, float(stamps[-1]))
        turning = math.nan
        if late_s - early_s > 0.5 * _RATE_OVER_S:
            (yaw_0, pitch_0), (yaw_1, pitch_1) = at(early_s), at(late_s)
            across = math.hypot((yaw_1 - yaw_0) * math.cos(pitch), pitch_1 - pitch_0)
            turning = across / (late_s - early_s)
        return wrap_angle(yaw), pitch, turning

    # --- the blade ----------------------------------------------------------------------------

    def _take_task(self, task: SensingTask) -> None:
        self._task = task
        if task.mode is not SensingMode.BLADE or task.blade_root_w is None:
            return
        if (task.blade, task.side) not in self._tasks or self._drift is None:
            rotor = self._rotor_of(task)
            if rotor is not None and self._drift is None:
                self._drift = FrameDrift(
                    self._positioning.wander_sigma_m,
                    self._positioning.wander_s,
                    rotor.stamp_s,
                    ROTOR_SIGMA_M,
                )
        self._tasks[task.blade, task.side] = task

    def _rotor_of(self, task: SensingTask) -> RotorEstimate | None:
        """Return the estimate that the flight is flown by: the one with the task's own hub."""
        if task.hub_w is None:
            return None
        hub = task.hub_w
        return min(self._rotors, key=lambda r: math.dist(r.hub_w, hub), default=None)

    def _take_motion(self, vehicle: Vehicle) -> None:
        """Follow the wander by what the position moves beyond the velocity."""
        if self._drift is None:
            return
        position_w, velocity_w = np.array(vehicle.position_w), np.array(vehicle.velocity_w)
        self._drift.move(vehicle.stamp_s, position_w, velocity_w)
        drift, covariance = self._drift.at(vehicle.stamp_s)
        self._drifts.append((vehicle.stamp_s, drift, covariance))

    def _take_turbine(self, drift: FrameDrift, seen: TurbineSeen | None) -> None:
        """Take a sighting of the whole turbine, each once."""
        if seen is None or seen.stamp_s <= self._turbine_s:
            return
        self._turbine_s = seen.stamp_s
        drift.sighted(seen.stamp_s, seen.offset_w, seen.heading_rad, seen.covariance)

    def _drift_then(self, stamp_s: float) -> tuple[Float, Float] | None:
        """Return the drift (3,) at a moment, and its covariance (3, 3)."""
        near = min(self._drifts, key=lambda then: abs(then[0] - stamp_s), default=None)
        if near is not None and abs(near[0] - stamp_s) < _NEAR_S:
            return near[1], near[2]
        return None if self._drift is None else self._drift.at(stamp_s)

    def _take_track(self, track: BladeTrack) -> None:
        self._tracks.append(track)
        task, drift = self._task, self._drift
        if task is None or drift is None:
            return
        self._take_turbine(drift, track.turbine)
        if track.blade != task.blade or track.from_model:
            return
        if task.blade_root_w is None or task.blade_tip_w is None or not self._vehicles:
            return
        root = np.array(task.blade_root_w)
        axis = np.array(task.blade_tip_w) - root
        length = float(np.linalg.norm(axis))
        axis = axis / length
        tip_m = self._settled_tip(track)
        if track.stamp_s - self._measured_s < _MEASURE_EVERY_S:
            return
        self._measured_s = track.stamp_s
        foot, offset = np.array(track.foot_w), np.array(track.offset_w)
        view = foot - np.array(self._vehicles[-1].position_w)
        view = view - (view @ axis) * axis
        view = view / np.linalg.norm(view)
        bend = _BEND_PER_METRE * max(0.0, float((foot - root) @ axis))
        aside = np.cross(axis, view)
        noise = self._positioning.noise_sigma_m
        sighted = track.stamp_s - self._turbine_s < SIGHTED_S
        for direction, sigma in ((view, _DEPTH_SIGMA_M), (aside, _ASIDE_SIGMA_M)):
            total = math.sqrt(sigma**2 + bend**2 + noise**2)
            if not sighted:
                drift.measure(track.stamp_s, direction, float(offset @ direction), total)
        if tip_m is not None:
            sigma = math.hypot(_TIP_SIGMA_M, noise)
            drift.measure(track.stamp_s, axis, tip_m - length, sigma)

    def _settled_tip(self, track: BladeTrack) -> float | None:
        """Return where the tip is seen, once the last scans agree on it."""
        if track.tip_m is None:
            self._tips.clear()
            return None
        self._tips.append(track.tip_m)
        if len(self._tips) < _TIPS:
            return None
        low, middle, high = np.quantile(self._tips, (0.1, 0.5, 0.9))
        spread = math.hypot(_TIP_SPREAD_M, self._positioning.noise_sigma_m)
        return float(middle) if high - low < 2 * spread else None

    def _blade(self, taken: PhotoTakenMessage) -> BladeThen | None:
        task = self._tasks.get((taken.command.blade, taken.command.side))
        if task is None or task.blade_root_w is None or task.blade_tip_w is None:
            return None
        rotor = self._rotor_of(task)
        if rotor is None or task.hub_w is None:
            return None
        pitch = {blade.name: blade.pitch_deg for blade in rotor.blades}.get(task.blade)
        root = np.array(task.blade_root_w)
        axis = np.array(task.blade_tip_w) - root
        drift: Float = np.zeros(3)
        unknown = 2 * self._positioning.wander_sigma_m**2 + ROTOR_SIGMA_M**2
        covariance: Float = unknown * np.eye(3)
        then = self._drift_then(taken.stamp_s)
        if then is not None:
            drift, covariance = then
        tracks = [
            track
            for track in self._tracks
            if track.blade == task.blade
            and not track.from_model
            and abs(track.stamp_s - taken.stamp_s) < _NEAR_S
        ]
        track = min(tracks, key=lambda t: abs(t.stamp_s - taken.stamp_s), default=None)
        return BladeThen(
            hub_w=np.array(task.hub_w),
            normal_w=np.array(rotor.normal_w if task.normal_w is None else task.normal_w),
            root_w=root,
            axis_w=axis / np.linalg.norm(axis),
            pitch_deg=pitch,
            track=track,
            drift_w=drift,
            drift_covariance=covariance,
        )


def body_to_world(moment: PhotoMoment, vector_b: tuple[float, float, float]) -> Float:
    """Return a body vector (FLU) in the world at the photo's moment."""
    vector: Float = rotation_from_quaternion(moment.quaternion_wb) @ np.asarray(vector_b)
    return vector
