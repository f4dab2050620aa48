"""The quick half of perception: clearance from every scan, the blade's line, the blade's exposure.

A process of its own, so that neither packets nor estimates wait for it, nor it for them.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
from pydantic import TypeAdapter

from config.presets import turbines_of
from drivers.bus import Bus, Key, Sample
from drivers.codecs import POINT_CLOUD, BadMessage, decode_frame, encode_points
from mission.flight.command import SensingMode, SensingTask
from mission.flight.exposure_order import ev_steps
from mission.flight.observation import (
    BladeTrack,
    ClearanceState,
    ExposureState,
    RequestKind,
)
from mission.processes.blade_follower import BladeFollower, followed, kept_s
from mission.processes.blade_metering import BladeMetering, MeteredBlade
from mission.processes.metering_shown import metering_shown
from mission.processes.runtime import Runtime, run_process
from mission.processes.sensor_inbox import SensorInbox
from mission.remote.messages import Intent
from perception.air_echoes import AirEchoes
from perception.clearance import OccupancyMemory, RepeatedScans
from perception.deskew import points_in_world
from perception.exposure import exposure_control
from perception.exposure_control import ExposureControl
from perception.frame_check import FrameCheck
from perception.geometry import camera_looking_along, rotation_from_quaternion, vec3
from perception.metering import histogram_of
from perception.steady_poses import NOISY_M, SteadyPoses
from perception.values import CameraPose, Float, Frame, Scan
from perception.warm_up import warm_up_tracking

#: Occupied points handed to the guard: all that a setpoint could lead near.
AROUND_M = 30.0
AROUND_POINTS = 1500
#: Turning faster than this, points farther than the reach are a metre or more out of place.
TURNING_RPS = math.radians(4.0)
TURNING_REACH_M = 15.0
STEADY_REACH_M = 45.0
RATE_WINDOW = 10

_CLEARANCE = TypeAdapter(ClearanceState)
_BLADE = TypeAdapter(BladeTrack)
_EXPOSURE = TypeAdapter(ExposureState)


class TrackingWorker:
    """Scans and frames in; clearance, blade line and exposure out."""

    def __init__(self, runtime: Runtime, bus: Bus) -> None:
        settings = runtime.settings
        self._settings = settings
        self._bus = bus
        self._clock = runtime.clock
        self._inbox = SensorInbox(bus, runtime.clock)
        ignore_m = settings.lidar.blind_range_m + settings.airframe.radius_m
        self._memory = OccupancyMemory(ignore_within_m=ignore_m)
        self._air = AirEchoes(field_of_view_sr=settings.lidar.field_of_view_sr)
        self._repeats = RepeatedScans()
        self._stamps: deque[float] = deque(maxlen=RATE_WINDOW)
        self._turbines = turbines_of(settings.sites)
        self._follower = BladeFollower(self._turbines, settings.positioning)
        self._metering = BladeMetering(settings, self._turbines)
        self._exposure: ExposureControl | None = None
        self._told_s = float("-inf")
        self._frames = FrameCheck()
        noisy = settings.positioning.noise_sigma_m > NOISY_M
        self._steady = SteadyPoses() if noisy else None
        self._foot_w: Float | None = None
        """(3,) where the LiDAR saw the blade last; among steadied poses, where there are."""
        self._rate_from_s = float("-inf")
        bus.subscribe_newest(Key.FRAME, self._take_frame)
        bus.subscribe(Key.INTENT, self._take_intent)

    async def run(self) -> None:
        """Work through the newest scan, again and again, until cancelled."""
        warm_up_tracking()
        await self._inbox.work("tracking", self.take_scan)

    # --- scans --------------------------------------------------------------------------------

    def take_scan(self, scan: Scan) -> None:
        """Publish clearance and surroundings of a scan and, along a blade, its line."""
        position_w = self._inbox.position()
        if position_w is None:
            return
        repeated = self._repeats.update(scan.points_l)
        points_w, origins_w = points_in_world(scan, list(self._inbox.poses), self._settings.lidar)
        origin = origins_w[-1] if len(origins_w) else position_w
        points_w = points_w[self._air.solid(points_w, origin)]
        if not repeated:
            near = np.linalg.norm(points_w - origin, axis=1) < self._reach_m()
            self._memory.update(points_w[near], scan.stamp_s, origin)
        self._publish_clearance(scan, position_w, repeated=repeated)
        task = self._inbox.task
        if task.mode is SensingMode.BLADE:
            self._follow_blade(task, points_w, scan.stamp_s, position_w)
        else:
            self._foot_w = None

    def _reach_m(self) -> float:
        """Return how far a point may be to be kept: a turning vehicle smears what is far."""
        poses = list(self._inbox.poses)[-8:]
        if len(poses) < 2 or poses[-1].stamp_s <= poses[0].stamp_s:
            return TURNING_REACH_M
        ahead = [
            rotation_from_quaternion(pose.quaternion_wb)[:, 0] for pose in (poses[0], poses[-1])
        ]
        turned = math.acos(min(1.0, max(-1.0, float(ahead[0] @ ahead[1]))))
        rate = turned / (poses[-1].stamp_s - poses[0].stamp_s)
        return TURNING_REACH_M if rate > TURNING_RPS else STEADY_REACH_M

    def _publish_clearance(self, scan: Scan, position_w: Float, *, repeated: bool) -> None:
        if scan.stamp_s >= self._rate_from_s:
            self._stamps.append(scan.stamp_s)
        span_s = self._stamps[-1] - self._stamps[0] if self._stamps else 0.0
        rate_hz = (len(self._stamps) - 1) / span_s if span_s > 0 else 10.0
        nearest = self._memory.nearest(position_w)
        state = ClearanceState(
            stamp_s=scan.stamp_s,
            sequence=scan.sequence,
            nearest_m=None if nearest is None else nearest[0],
            nearest_w=None if nearest is None else vec3(nearest[1]),
            scan_rate_hz=rate_hz,
            repeated=repeated,
        )
        around = self._memory.around(
            position_w, AROUND_M, AROUND_POINTS,
            not_before_s=scan.stamp_s - kept_s(self._settings.positioning),
            followed=followed(self._inbox.task, scan.stamp_s),
        )  # fmt: skip
        self._bus.publish(Key.OCCUPANCY, encode_points(around, scan.stamp_s), encoding=POINT_CLOUD)
        self._bus.publish(Key.CLEARANCE, _CLEARANCE.dump_json(state))

    def _follow_blade(
        self, task: SensingTask, points_w: Float, stamp_s: float, position_w: Float
    ) -> None:
        velocity_w = self._inbox.poses[-1].velocity_w if self._inbox.poses else None
        track = self._follower.follow(task, points_w, stamp_s, position_w, velocity_w)
        self._foot_w = None
        if track is not None and not track.from_model:
            self._foot_w = np.asarray(track.foot_w) + self._moved_w(track.stamp_s)
        if track is not None:
            self._bus.publish(Key.BLADE, _BLADE.dump_json(track))

    def _take_intent(self, sample: Sample) -> None:
        """A mission begins: how seldom scans came while everything rested says nothing of it."""
        if Intent.model_validate_json(sample.payload).kind is RequestKind.START:
            self._rate_from_s = self._clock.now_s()
            self._stamps.clear()

    # --- frames -------------------------------------------------------------------------------

    def _take_frame(self, sample: Sample) -> None:
        try:
            frame = decode_frame(sample.payload, sample.attachment)
        except BadMessage:
            return
        self._inbox.tell_taken("tracking", "frame", frame.stamp_s)
        control = self._control()
        now_s = self._inbox.poses[-1].stamp_s if self._inbox.poses else frame.stamp_s
        usable = self._frames.usable(frame.grey, frame.stamp_s, now_s)
        if control is None or not usable or self._inbox.task.mode is not SensingMode.BLADE:
            return
        found = self._meter(frame)
        if found is None or found.metered is None:
            return
        metered = found.metered
        limits, aside = self._settings.exposure, self._inbox.task.still_offset_grey
        control.aim(limits.target_grey - aside)
        # On the way to a pass no photo is near: the camera's curve may be looked at.
        spare = found.range_m > self._settings.tracking.max_distance_m
        wanted = control.update(metered, frame.stamp_s, histogram_of(frame.grey), spare=spare)
        state = ExposureState(
            stamp_s=frame.stamp_s,
            mean_grey=metered.mean_grey,
            in_range=limits.min_grey <= metered.mean_grey + aside <= limits.max_grey,
            ev_wanted=wanted,
            clipped=metered.clipped,
            pixels=metered.pixels,
            at_limit=control.at_limit,
        )
        self._bus.publish(Key.EXPOSURE, _EXPOSURE.dump_json(state))

    def _control(self) -> ExposureControl | None:
        """Return the controller, told of what the camera confirmed; None for a camera without EV.

        One for the whole mission: what it learned of the camera holds from leg to leg.
        """
        cameras = [camera for camera in list(self._inbox.cameras) if camera.ev is not None]
        if not cameras:
            return None
        steps = ev_steps(cameras[-1])
        if self._exposure is None:
            automatic = not cameras[-1].manual
            self._exposure = exposure_control(self._settings.exposure, steps, automatic=automatic)
        self._exposure.limit(steps)
        for camera in cameras:
            if camera.ev is not None and camera.ev_stamp_s > self._told_s:
                self._told_s = camera.ev_stamp_s
                self._exposure.confirmed(camera.ev, camera.ev_stamp_s)
        return self._exposure

    def _meter(self, frame: Frame) -> MeteredBlade | None:
        """Meter the blade's own pixels, and show where that was."""
        camera = self._camera_pose(frame.stamp_s)
        if camera is None:
            return None
        if self._foot_w is not None:
            # Picture and scan are of two moments, between which a position may jitter.
            moved_w = self._moved_w(frame.stamp_s)
            camera = replace(camera, position_w=camera.position_w + moved_w)
        found = self._metering.meter(frame, camera, self._inbox.task, self._foot_w)
        if found is None:
            return None
        height, width = frame.grey.shape
        shown = metering_shown(
            frame.stamp_s, (width, height), found.centre_px, found.radius_px, found.outline_px
        )
        if shown is not None:
            self._bus.publish(Key.METERING, shown.model_dump_json().encode(), droppable=True)
        return found

    def _moved_w(self, stamp_s: float) -> Float:
        if self._steady is None:
            return np.zeros(3)
        self._steady.follow(self._inbox.poses)
        return self._steady.moved_w(stamp_s)

    def _camera_pose(self, stamp_s: float) -> CameraPose | None:
        gimbal = self._inbox.gimbal_at(stamp_s)
        poses = self._inbox.poses
        if gimbal is None or not poses:
            return None
        pose = min(poses, key=lambda one: abs(one.stamp_s - stamp_s))
        body = rotation_from_quaternion(pose.quaternion_wb)
        drift = pose.velocity_w * (stamp_s - pose.stamp_s)
        eye_w = pose.position_w + drift + body @ np.asarray(self._settings.camera.offset_m)
        cosine = math.cos(gimbal.pitch_rad)
        direction = (
            cosine * math.cos(gimbal.yaw_rad),
            cosine * math.sin(gimbal.yaw_rad),
            math.sin(gimbal.pitch_rad),
        )
        return CameraPose(stamp_s, eye_w, camera_looking_along(direction))


async def track(runtime: Runtime) -> None:
    """Run the worker until cancelled."""
    with runtime.open_bus() as bus:
        await TrackingWorker(runtime, bus).run()


if __name__ == "__main__":
    run_process("tracking", track, niceness=-6)
