"""What a viewer of the recording is shown beside the data: transforms, poses, scene, log.

Made from what goes over the bus, in Foxglove's schemas; frames: `world` (ENU, where the flight
began), `body` (forward, left, up), `lidar`, `camera` (right, down, along the optical axis).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from pydantic import TypeAdapter, ValidationError

from config.settings import Settings
from drivers.bus import Key
from drivers.codecs import BadMessage, decode_frame
from mission.flight.command import SensingTask
from mission.flight.observation import (
    BladeTrack,
    GimbalState,
    HubPrior,
    RotorEstimate,
    Vec3,
    Vehicle,
)
from mission.records.scene_shapes import (
    Rgba,
    add_ball,
    add_cone,
    add_line,
    colour_of,
    entity_of,
    place_at,
    ring_of,
    stamp_of,
)
from mission.remote.messages import (
    EventMessage,
    PhotoResultMessage,
    PhotoTakenMessage,
    VehicleMessage,
)
from mission.remote.plan_message import PlanMessage
from perception.geometry import (
    camera_looking_along,
    lidar_in_body,
    quaternion_from_rotation,
    rotation_from_quaternion,
    vec3,
)

TRANSFORMS = "view/transforms"
POSE = "view/pose"
LOCATION = "view/location"
CALIBRATION = "view/calibration"
SCENE = "view/scene"
LOG = "view/log"

VIEW_CHANNELS: dict[str, type[Message]] = {
    TRANSFORMS: FrameTransforms,
    POSE: PoseInFrame,
    LOCATION: LocationFix,
    CALIBRATION: CameraCalibration,
    SCENE: SceneUpdate,
    LOG: Log,
}

Shown: TypeAlias = Iterator[tuple[str, Message]]

_STEEL: Rgba = (0.56, 0.64, 0.69, 0.55)
_ROTOR: Rgba = (0.17, 0.43, 0.62, 1.0)
_RING: Rgba = (0.17, 0.43, 0.62, 0.5)
_PLANE: Rgba = (0.17, 0.43, 0.62, 0.08)
_PLANNED: Rgba = (0.62, 0.55, 0.85, 0.8)
_BLIND: Rgba = (0.62, 0.55, 0.85, 0.35)
_PRIOR: Rgba = (0.66, 0.39, 0.0, 0.7)
_FOOT: Rgba = (0.9, 0.55, 0.1, 1.0)
_KEPT: Rgba = (0.13, 0.55, 0.33, 1.0)
_REJECTED: Rgba = (0.7, 0.15, 0.12, 1.0)
_WAITING: Rgba = (0.6, 0.6, 0.6, 1.0)
#: What is covered is drawn off the blade, on the side from which it was seen.
_BESIDE_M = 2.0
_LEVELS = {"none": Log.INFO, "warn": Log.WARNING}

_TASK = TypeAdapter(SensingTask)
_ROTOR_JSON = TypeAdapter(RotorEstimate)
_PRIOR_JSON = TypeAdapter(HubPrior)
_BLADE = TypeAdapter(BladeTrack)


class SceneView:
    """Turns messages of the bus into what a viewer is shown. Remembers what is on the scene."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._task: SensingTask | None = None
        self._photos: dict[int, PhotoTakenMessage] = {}
        self._along: dict[str, Vec3] = {}
        """Of each blade, from its root to its tip."""
        self._calibrated_ns = -(1 << 62)
        self._stream_px: tuple[int, int] | None = None
        self._makers: dict[str, Callable[[bytes, int], Shown]] = {
            Key.VEHICLE: self._vehicle,
            Key.FRAME: self._frame,
            Key.TASK: self._of_task,
            Key.HUB_PRIOR: self._prior,
            Key.ROTOR: self._rotor,
            Key.BLADE: self._blade,
            Key.PLAN: self._plan,
            Key.PHOTO: self._photo,
            Key.PHOTO_RESULT: self._photo_result,
            Key.EVENT: self._event,
        }

    def of(self, key: str, payload: bytes, now_ns: int) -> Shown:
        """Yield (topic, message) shown for a message of the bus; nothing for one that is broken."""
        maker = self._makers.get(key)
        if maker is None:
            return
        try:
            yield from maker(payload, now_ns)
        except (ValidationError, BadMessage):
            return

    # --- the vehicle --------------------------------------------------------------------------

    def _vehicle(self, payload: bytes, _now_ns: int) -> Shown:
        message = VehicleMessage.model_validate_json(payload)
        vehicle = message.vehicle
        if vehicle is None:
            return
        stamp = stamp_of(round(vehicle.stamp_s * 1e9))
        yield TRANSFORMS, self._transforms(vehicle, message.gimbal, stamp)
        pose = PoseInFrame(timestamp=stamp, frame_id="world")
        place_at(pose.pose, vehicle.position_w, vehicle.quaternion_wb)
        yield POSE, pose
        if vehicle.latitude_deg is not None and vehicle.longitude_deg is not None:
            yield (
                LOCATION,
                LocationFix(
                    timestamp=stamp,
                    frame_id="body",
                    latitude=vehicle.latitude_deg,
                    longitude=vehicle.longitude_deg,
                    altitude=vehicle.altitude_m or 0.0,
                ),
            )

    def _transforms(
        self, vehicle: Vehicle, gimbal: GimbalState | None, stamp: Timestamp
    ) -> FrameTransforms:
        lidar, camera = self._settings.lidar, self._settings.camera
        mounted = quaternion_from_rotation(lidar_in_body(lidar.nose_down_deg))
        found = [
            ("world", "body", vehicle.position_w, vehicle.quaternion_wb),
            ("body", "lidar", lidar.offset_m, tuple(mounted)),
        ]
        if gimbal is not None:
            body = rotation_from_quaternion(vehicle.quaternion_wb)
            eye = np.asarray(vehicle.position_w) + body @ np.asarray(camera.offset_m)
            level = math.cos(gimbal.pitch_rad)
            axis = (
                level * math.cos(gimbal.yaw_rad),
                level * math.sin(gimbal.yaw_rad),
                math.sin(gimbal.pitch_rad),
            )
            turned = quaternion_from_rotation(camera_looking_along(axis))
            found.append(("world", "camera", tuple(eye), tuple(turned)))
        transforms = FrameTransforms()
        for parent, child, place, turn in found:
            one = FrameTransform(timestamp=stamp, parent_frame_id=parent, child_frame_id=child)
            one.translation.x, one.translation.y, one.translation.z = place
            one.rotation.w, one.rotation.x, one.rotation.y, one.rotation.z = turn
            transforms.transforms.append(one)
        return transforms

    def _frame(self, payload: bytes, now_ns: int) -> Shown:
        """Show once a second how the live picture sees: the lens over the stream's width."""
        if self._stream_px is None:
            height, width = decode_frame(payload, None).grey.shape
            self._stream_px = width, height
        if now_ns - self._calibrated_ns >= 1_000_000_000:
            self._calibrated_ns = now_ns
            yield CALIBRATION, self._calibration(*self._stream_px, stamp_of(now_ns))

    def _calibration(self, width: int, height: int, stamp: Timestamp) -> CameraCalibration:
        camera = self._settings.camera
        focal = camera.focal_length_mm / camera.sensor_width_mm * width
        across, down = width / 2, height / 2
        return CameraCalibration(
            timestamp=stamp,
            frame_id="camera",
            width=width,
            height=height,
            distortion_model="plumb_bob",
            D=list(camera.distortion),
            K=[focal, 0, across, 0, focal, down, 0, 0, 1],
            R=[1, 0, 0, 0, 1, 0, 0, 0, 1],
            P=[focal, 0, across, 0, 0, focal, down, 0, 0, 0, 1, 0],
        )

    # --- the turbine --------------------------------------------------------------------------

    def _of_task(self, payload: bytes, now_ns: int) -> Shown:
        task = _TASK.validate_json(payload)
        if task == self._task:
            return
        self._task = task
        solids = entity_of("turbine", now_ns)
        for one, other, radius, far_radius in task.others:
            add_cone(solids, one, other, radius, far_radius, _STEEL)
        axis = entity_of("blade axis", now_ns)
        if task.blade_root_w is not None and task.blade_tip_w is not None:
            add_line(axis, [task.blade_root_w, task.blade_tip_w], _PRIOR, 0.15)
        yield SCENE, SceneUpdate(entities=[solids, axis])

    def _prior(self, payload: bytes, now_ns: int) -> Shown:
        prior = _PRIOR_JSON.validate_json(payload)
        entity = entity_of("prior", now_ns)
        tower, axis = np.asarray(prior.tower_w), np.asarray(prior.tower_axis_w)
        top = tower + axis * (40.0 if prior.tower_top_m is None else prior.tower_top_m - tower[2])
        add_line(entity, [prior.tower_w, tuple(top)], _PRIOR, 0.3)
        if prior.hub_w is not None:
            add_ball(entity, prior.hub_w, 2.0, _PRIOR)
            if prior.normal_w is not None:
                out = np.asarray(prior.hub_w) - 15.0 * np.asarray(prior.normal_w)
                add_line(entity, [prior.hub_w, tuple(out)], _PRIOR, 0.2)
        yield SCENE, SceneUpdate(entities=[entity])

    def _rotor(self, payload: bytes, now_ns: int) -> Shown:
        rotor = _ROTOR_JSON.validate_json(payload)
        if rotor.refusal is not None:
            return
        hub, normal = np.asarray(rotor.hub_w), np.asarray(rotor.normal_w)
        entity = entity_of("rotor", now_ns)
        add_ball(entity, rotor.hub_w, 2.0, _ROTOR)
        add_line(entity, [rotor.hub_w, vec3(hub - 15.0 * normal)], _ROTOR, 0.2)
        self._along = {blade.name: blade.direction_w for blade in rotor.blades}
        reach = 0.0
        for blade in rotor.blades:
            length = 30.0 if blade.length_m is None else blade.length_m
            reach = max(reach, length)
            tip = hub + length * np.asarray(blade.direction_w)
            add_line(entity, [rotor.hub_w, tuple(tip)], _ROTOR, 0.4)
            text = entity.texts.add(text=blade.name, billboard=True, font_size=4.0)
            text.color.CopyFrom(colour_of(_ROTOR))
            place_at(text.pose, tuple(tip))
        if reach:
            add_line(entity, ring_of(hub, normal, reach), _RING, 0.15)
            near, far = vec3(hub - 0.05 * normal), vec3(hub + 0.05 * normal)
            add_cone(entity, near, far, reach, reach, _PLANE)
        yield SCENE, SceneUpdate(entities=[entity])

    def _blade(self, payload: bytes, now_ns: int) -> Shown:
        track = _BLADE.validate_json(payload)
        entity = entity_of("foot", now_ns)
        foot, along = np.asarray(track.foot_w), np.asarray(track.direction_w)
        add_ball(entity, track.foot_w, 0.6, _FOOT)
        add_line(entity, [tuple(foot - 5 * along), tuple(foot + 5 * along)], _FOOT, 0.12)
        yield SCENE, SceneUpdate(entities=[entity])

    def _plan(self, payload: bytes, now_ns: int) -> Shown:
        plan = PlanMessage.model_validate_json(payload)
        entity = entity_of("plan", now_ns)
        for leg in plan.legs:
            add_line(entity, leg.line_w, _BLIND if leg.blind else _PLANNED, 0.12)
        yield SCENE, SceneUpdate(entities=[entity])

    # --- photos and events --------------------------------------------------------------------

    def _photo(self, payload: bytes, now_ns: int) -> Shown:
        taken = PhotoTakenMessage.model_validate_json(payload)
        self._photos[taken.command.photo_id] = taken
        yield SCENE, SceneUpdate(entities=[self._shown(taken, now_ns, _WAITING)])

    def _photo_result(self, payload: bytes, now_ns: int) -> Shown:
        result = PhotoResultMessage.model_validate_json(payload)
        taken = self._photos.get(result.photo_id)
        if taken is not None:
            colour = _KEPT if result.kept else _REJECTED
            yield SCENE, SceneUpdate(entities=[self._shown(taken, now_ns, colour)])

    def _shown(self, taken: PhotoTakenMessage, now_ns: int, colour: Rgba) -> SceneEntity:
        """Return a photo as a ball on the blade and, beside it, the stretch that it shows."""
        entity = entity_of(f"photo {taken.command.photo_id}", now_ns)
        place = taken.position_w if taken.foot_w is None else taken.foot_w
        add_ball(entity, place, 0.8, colour)
        along, foot = self._along.get(taken.command.blade), np.asarray(place)
        if along is not None and taken.foot_w is not None and taken.distance_m:
            towards = np.asarray(taken.position_w) - foot
            shown = foot + _BESIDE_M * towards / np.linalg.norm(towards)
            camera = self._settings.camera
            half_m = taken.distance_m * camera.sensor_height_mm / camera.focal_length_mm / 2
            reach = half_m * np.asarray(along)
            add_line(entity, [vec3(shown - reach), vec3(shown + reach)], colour, 0.3)
        return entity

    def _event(self, payload: bytes, now_ns: int) -> Shown:
        event = EventMessage.model_validate_json(payload)
        level = _LEVELS.get(event.severity, Log.ERROR)
        yield LOG, Log(timestamp=stamp_of(now_ns), level=level, message=event.text, name=event.name)
