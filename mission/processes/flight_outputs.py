"""What flight says on the bus: vehicle, state, task, events, ticks, photos, report."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

from pydantic import TypeAdapter

from drivers.bus import Bus, Key
from drivers.payload_camera import PhotoTaken
from mission.flight.command import PhotoCommand, Progress, SensingTask
from mission.flight.events import EventRecord
from mission.flight.guard import GuardedCommand
from mission.flight.machine import Machine
from mission.flight.observation import CameraState, GimbalState, Observation, Vec3, Vehicle
from mission.flight.plan import Plan
from mission.processes.flight_asked import AskedMission
from mission.processes.flight_inputs import FlightInputs
from mission.processes.flight_pace import Pace
from mission.processes.runtime import Runtime
from mission.remote.messages import (
    EventMessage,
    FlightReport,
    Intent,
    PhotoTakenMessage,
    StateMessage,
    TickRecord,
    VehicleMessage,
)
from mission.remote.plan_message import told

_TASK = TypeAdapter(SensingTask)
TASK_PERIOD_S = 1.0


class FlightOutputs:
    """Puts flight's messages together and publishes them."""

    def __init__(self, bus: Bus, runtime: Runtime, pace: Pace) -> None:
        self._bus = bus
        self._pace = pace
        self._settings = runtime.settings
        self._clock = runtime.clock
        self._task: SensingTask | None = None
        self._task_sent_s = float("-inf")
        self._utc_of_zero = _utc_of_mission_zero(runtime)
        self._factors: list[float] = []
        self._plan: Plan | None = None
        self._history: list[tuple[Vehicle, GimbalState | None]] = []
        self._cameras: list[CameraState] = []
        """One of each exposure that the camera confirmed of late."""

    def begin(self) -> None:
        """A new mission begins."""
        self._factors.clear()

    def vehicle(self, observation: Observation) -> None:
        """Publish vehicle, gimbal and camera."""
        if observation.vehicle is not None:
            self._history.append((observation.vehicle, observation.gimbal))
            del self._history[:-60]
        camera = observation.camera
        if camera is not None and (
            not self._cameras or camera.ev_stamp_s > self._cameras[-1].ev_stamp_s
        ):
            self._cameras.append(camera)
            del self._cameras[:-20]
        message = VehicleMessage(
            vehicle=observation.vehicle, gimbal=observation.gimbal, camera=observation.camera
        )
        self._bus.publish(Key.VEHICLE, message.model_dump_json().encode())

    def task(self, task: SensingTask, now_s: float) -> None:
        """Publish the sensing task when it changes, and once a second for late joiners."""
        if task == self._task and now_s - self._task_sent_s < TASK_PERIOD_S:
            return
        self._task, self._task_sent_s = task, now_s
        self._bus.publish(Key.TASK, _TASK.dump_json(task))

    def event(self, event: EventRecord) -> None:
        """Publish one line of the event log."""
        message = EventMessage(
            mission_s=event.t_s,
            name=event.name,
            severity=event.severity.name.lower(),
            text=event.text,
        )
        self._bus.publish(Key.EVENT, message.model_dump_json().encode())

    def tick(
        self,
        observation: Observation,
        guarded: GuardedCommand,
        *,
        sent: bool,
        surroundings_s: float,
    ) -> None:
        """Publish what was known, decided and sent: all that a replay of the tick needs."""
        record = TickRecord.model_construct(
            observation=observation,
            command=guarded.command,
            refused=guarded.reason,
            sent=sent,
            surroundings_s=surroundings_s,
        )
        self._bus.publish(Key.COMMAND, record.model_dump_json().encode(), droppable=True)

    def state(
        self,
        progress: Progress,
        observation: Observation | None,
        inputs: FlightInputs,
        intent: Intent | None,
        *,
        link_ok: bool = True,
        resting: bool = False,
    ) -> None:
        """Publish what an operator is shown."""
        now_s = self._clock.now_s()
        self._factors.append(self._clock.factor())
        vehicle = None if observation is None else observation.vehicle
        camera = None if observation is None else observation.camera
        clearance = inputs.clearance
        message = StateMessage(
            vehicle=self._settings.vehicle,
            mission_dir="" if intent is None else intent.mission_dir,
            site="" if intent is None else intent.site,
            mission_s=now_s,
            factor=self._clock.factor(),
            progress=progress,
            position_w=None if vehicle is None else vehicle.position_w,
            height_m=None if vehicle is None else _height_m(vehicle),
            battery=None if vehicle is None else vehicle.battery,
            lidar_age_s=None if clearance is None else now_s - clearance.stamp_s,
            ev=None if camera is None else camera.ev,
            grey=None if inputs.exposure is None else inputs.exposure.mean_grey,
            link_ok=link_ok,
            yaw_rad=None if vehicle is None else vehicle.yaw_rad,
            loop_lag_ms=self._pace.lag_ms.worst(now_s),
            setpoint_gap_ms=self._pace.gap_ms.worst(now_s),
            resting=resting,
        )
        self._bus.publish(Key.STATE, message.model_dump_json().encode())

    def photo(
        self, photo: PhotoTaken, command: PhotoCommand, newest: Observation
    ) -> PhotoTakenMessage | None:
        """Publish that a photo exists, with everything known at its moment, and return that."""
        vehicle, gimbal = self._at(photo.stamp_s, newest)
        if vehicle is None:
            return None
        camera = self._set_at(photo.stamp_s, newest)
        foot = command.foot_w
        distance_m = command.distance_m if foot is None else math.dist(foot, vehicle.position_w)
        message = PhotoTakenMessage(
            command=command,
            url=photo.file_url,
            index=photo.index,
            stamp_s=photo.stamp_s,
            utc=self._utc(photo.stamp_s),
            position_w=vehicle.position_w,
            height_m=_height_m(vehicle),
            quaternion_wb=vehicle.quaternion_wb,
            gimbal_yaw_rad=vehicle.yaw_rad if gimbal is None else gimbal.yaw_rad,
            gimbal_pitch_rad=0.0 if gimbal is None else gimbal.pitch_rad,
            foot_w=foot,
            distance_m=distance_m,
            ev=None if camera is None else camera.ev,
            shutter_s=None if camera is None else camera.shutter_s,
            latitude_deg=vehicle.latitude_deg,
            longitude_deg=vehicle.longitude_deg,
            altitude_m=vehicle.altitude_m,
        )
        self._bus.publish(Key.PHOTO, message.model_dump_json().encode())
        return message

    def journal(self, machine: Machine, mission: AskedMission, vehicle: Vehicle | None) -> None:
        """Publish how the flight stands: what the journal keeps should this process be lost.

        A plan that was made since is told with it.
        """
        if machine.plan is not self._plan:
            self._plan = machine.plan
            if machine.plan is not None:
                plan = told(machine.plan)
                self._bus.publish(Key.PLAN, plan.model_dump_json().encode())
        message = FlightReport.model_construct(
            report=machine.report(brief=True),
            site=mission.intent.site,
            turbine=mission.turbine.name,
            operator=mission.intent.operator,
            rotor_locked=mission.intent.rotor_locked,
            started_utc=mission.started_utc,
            tower_foot_w=machine.tower_foot_w(),
            place=_place(vehicle),
        )
        self._bus.publish(Key.JOURNAL, message.model_dump_json().encode())

    def report(
        self,
        machine: Machine,
        mission: AskedMission,
        inputs: FlightInputs,
        tick_gap_ms: dict[str, float],
    ) -> None:
        """Publish the flight's part of mission.json."""
        foot = machine.tower_foot_w()
        message = FlightReport.model_construct(
            report=machine.report(),
            site=mission.intent.site,
            turbine=mission.turbine.name,
            operator=mission.intent.operator,
            rotor_locked=mission.intent.rotor_locked,
            started_utc=mission.started_utc,
            tower_foot_w=foot,
            frames=inputs.frames,
            frames_out_of_range=inputs.frames_out_of_range,
            real_time_factor=sum(self._factors) / len(self._factors) if self._factors else None,
            tick_gap_ms=tick_gap_ms,
        )
        self._bus.publish(Key.REPORT, message.model_dump_json().encode())

    def _at(self, stamp_s: float, newest: Observation) -> tuple[Vehicle | None, GimbalState | None]:
        if not self._history:
            return newest.vehicle, newest.gimbal
        return min(self._history, key=lambda pair: abs(pair[0].stamp_s - stamp_s))

    def _set_at(self, stamp_s: float, newest: Observation) -> CameraState | None:
        """Return the camera as it was set when a shutter opened: word of that comes later."""
        confirmed = [camera for camera in self._cameras if camera.ev_stamp_s <= stamp_s]
        return confirmed[-1] if confirmed else newest.camera

    def _utc(self, mission_s: float) -> str:
        moment = self._utc_of_zero + timedelta(seconds=mission_s)
        return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _height_m(vehicle: Vehicle) -> float:
    """Return the height above take-off, where the vehicle tells where that was."""
    return vehicle.position_w[2] - (0.0 if vehicle.home_w is None else vehicle.home_w[2])


def _place(vehicle: Vehicle | None) -> tuple[float, float, Vec3] | None:
    """Return where on the globe a place of the local frame is."""
    if vehicle is None or vehicle.latitude_deg is None or vehicle.longitude_deg is None:
        return None
    return vehicle.latitude_deg, vehicle.longitude_deg, vehicle.position_w


def _utc_of_mission_zero(runtime: Runtime) -> datetime:
    return datetime.now(UTC) - timedelta(seconds=runtime.clock.now_s())
