"""What a viewer of the recording is shown beside the data: transforms, poses, scene, log.

Made from what goes over the bus, in Foxglove's schemas; frames: `world` (ENU, where the flight
began), `body` (forward, left, up), `lidar`, `camera` (right, down, along the optical axis).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Pose_pb2 import Pose
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
from mission.remote.messages import (
    EventMessage,
    PhotoResultMessage,
    PhotoTakenMessage,
    VehicleMessage,
)
from perception.geometry import (
    camera_looking_along,
    lidar_in_body,
    quaternion_from_rotation,
    rotation_from_quaternion,
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
Rgba: TypeAlias = tuple[float, float, float, float]

_STEEL: Rgba = (0.56, 0.64, 0.69, 0.55)
_ROTOR: Rgba = (0.17, 0.43, 0.62, 1.0)
_RING: Rgba = (0.17, 0.43, 0.62, 0.5)
_PRIOR: Rgba = (0.66, 0.39, 0.0, 0.7)
_FOOT: Rgba = (0.9, 0.55, 0.1, 1.0)
_KEPT: Rgba = (0.13, 0.55, 0.33, 1.0)
_REJECTED: Rgba = (0.7, 0.15, 0.12, 1.0)
_WAITING: Rgba = (0.6, 0.6, 0.6, 1.0)
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
        self._photos: dict[int, Vec3] = {}
        self._calibrated_ns = -(1 << 62)
        self._stream_px: tuple[int, int] | None = None
        self._makers: dict[str, Callable[[bytes, int], Shown]] = {
            Key.VEHICLE: self._vehicle,
            Key.FRAME: self._frame,
            Key.TASK: self._of_task,
            Key.HUB_PRIOR: self._prior,
            Key.ROTOR: self._rotor,
            Key.BLADE: self._blade,
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
        stamp = _stamp(round(vehicle.stamp_s * 1e9))
        yield TRANSFORMS, self._transforms(vehicle, message.gimbal, stamp)
        pose = PoseInFrame(timestamp=stamp, frame_id="world")
        _place(pose.pose, vehicle.position_w, vehicle.quaternion_wb)
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
            yield CALIBRATION, self._calibration(*self._stream_px, _stamp(now_ns))

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
        solids = _entity("turbine", now_ns)
        for one, other, radius, far_radius in task.others:
            _cone(solids, one, other, radius, far_radius, _STEEL)
        axis = _entity("blade axis", now_ns)
        if task.blade_root_w is not None and task.blade_tip_w is not None:
            _line(axis, [task.blade_root_w, task.blade_tip_w], _PRIOR, 0.15)
        yield SCENE, SceneUpdate(entities=[solids, axis])

    def _prior(self, payload: bytes, now_ns: int) -> Shown:
        prior = _PRIOR_JSON.validate_json(payload)
        entity = _entity("prior", now_ns)
        tower, axis = np.asarray(prior.tower_w), np.asarray(prior.tower_axis_w)
        top = tower + axis * (40.0 if prior.tower_top_m is None else prior.tower_top_m - tower[2])
        _line(entity, [prior.tower_w, tuple(top)], _PRIOR, 0.3)
        if prior.hub_w is not None:
            _ball(entity, prior.hub_w, 2.0, _PRIOR)
            if prior.normal_w is not None:
                out = np.asarray(prior.hub_w) - 15.0 * np.asarray(prior.normal_w)
                _line(entity, [prior.hub_w, tuple(out)], _PRIOR, 0.2)
        yield SCENE, SceneUpdate(entities=[entity])

    def _rotor(self, payload: bytes, now_ns: int) -> Shown:
        rotor = _ROTOR_JSON.validate_json(payload)
        if rotor.refusal is not None:
            return
        hub, normal = np.asarray(rotor.hub_w), np.asarray(rotor.normal_w)
        entity = _entity("rotor", now_ns)
        _ball(entity, rotor.hub_w, 2.0, _ROTOR)
        _line(entity, [rotor.hub_w, tuple(hub - 15.0 * normal)], _ROTOR, 0.2)
        reach = 0.0
        for blade in rotor.blades:
            length = 30.0 if blade.length_m is None else blade.length_m
            reach = max(reach, length)
            tip = hub + length * np.asarray(blade.direction_w)
            _line(entity, [rotor.hub_w, tuple(tip)], _ROTOR, 0.4)
            text = entity.texts.add(text=blade.name, billboard=True, font_size=4.0)
            text.color.CopyFrom(_colour(_ROTOR))
            _place(text.pose, tuple(tip))
        if reach:
            _line(entity, _ring(hub, normal, reach), _RING, 0.15)
        yield SCENE, SceneUpdate(entities=[entity])

    def _blade(self, payload: bytes, now_ns: int) -> Shown:
        track = _BLADE.validate_json(payload)
        entity = _entity("foot", now_ns)
        foot, along = np.asarray(track.foot_w), np.asarray(track.direction_w)
        _ball(entity, track.foot_w, 0.6, _FOOT)
        _line(entity, [tuple(foot - 5 * along), tuple(foot + 5 * along)], _FOOT, 0.12)
        yield SCENE, SceneUpdate(entities=[entity])

    # --- photos and events --------------------------------------------------------------------

    def _photo(self, payload: bytes, now_ns: int) -> Shown:
        taken = PhotoTakenMessage.model_validate_json(payload)
        place = taken.position_w if taken.foot_w is None else taken.foot_w
        self._photos[taken.command.photo_id] = place
        yield SCENE, SceneUpdate(entities=[_photo(taken.command.photo_id, place, now_ns, _WAITING)])

    def _photo_result(self, payload: bytes, now_ns: int) -> Shown:
        result = PhotoResultMessage.model_validate_json(payload)
        place = self._photos.get(result.photo_id)
        if place is not None:
            colour = _KEPT if result.kept else _REJECTED
            yield SCENE, SceneUpdate(entities=[_photo(result.photo_id, place, now_ns, colour)])

    def _event(self, payload: bytes, now_ns: int) -> Shown:
        event = EventMessage.model_validate_json(payload)
        level = _LEVELS.get(event.severity, Log.ERROR)
        yield LOG, Log(timestamp=_stamp(now_ns), level=level, message=event.text, name=event.name)


def _photo(photo_id: int, place: Vec3, now_ns: int, colour: Rgba) -> SceneEntity:
    entity = _entity(f"photo {photo_id}", now_ns)
    _ball(entity, place, 0.8, colour)
    return entity


def _stamp(nanoseconds: int) -> Timestamp:
    seconds, nanos = divmod(nanoseconds, 1_000_000_000)
    return Timestamp(seconds=seconds, nanos=nanos)


def _entity(name: str, now_ns: int) -> SceneEntity:
    return SceneEntity(timestamp=_stamp(now_ns), frame_id="world", id=name)


def _colour(rgba: Rgba) -> Color:
    return Color(r=rgba[0], g=rgba[1], b=rgba[2], a=rgba[3])


def _place(
    pose: Pose, place: Sequence[float], turn: Sequence[float] = (1.0, 0.0, 0.0, 0.0)
) -> None:
    """Fill a foxglove.Pose: metres; w x y z."""
    position, orientation = pose.position, pose.orientation
    position.x, position.y, position.z = (float(v) for v in place)
    orientation.w, orientation.x, orientation.y, orientation.z = (float(v) for v in turn)


def _line(
    entity: SceneEntity, points: Sequence[Sequence[float]], rgba: Rgba, wide_m: float
) -> None:
    line = entity.lines.add(thickness=wide_m)
    line.pose.orientation.w = 1.0
    line.color.CopyFrom(_colour(rgba))
    for x, y, z in points:
        line.points.add(x=float(x), y=float(y), z=float(z))


def _ball(entity: SceneEntity, place: Sequence[float], wide_m: float, rgba: Rgba) -> None:
    ball = entity.spheres.add()
    _place(ball.pose, place)
    ball.size.x = ball.size.y = ball.size.z = wide_m
    ball.color.CopyFrom(_colour(rgba))


def _cone(
    entity: SceneEntity, one: Vec3, other: Vec3, radius: float, far_radius: float, rgba: Rgba
) -> None:
    """Add a truncated cone between two ends with the radius at each."""
    first, second = np.asarray(one), np.asarray(other)
    length = float(np.linalg.norm(second - first))
    if length <= 0:
        return
    up = (second - first) / length
    side = np.cross(up, (1.0, 0.0, 0.0) if abs(up[0]) < 0.9 else (0.0, 1.0, 0.0))
    side /= np.linalg.norm(side)
    turn = quaternion_from_rotation(np.column_stack([side, np.cross(up, side), up]))
    most = max(radius, far_radius)
    cone = entity.cylinders.add(bottom_scale=radius / most, top_scale=far_radius / most)
    _place(cone.pose, tuple((first + second) / 2), tuple(turn))
    cone.size.x = cone.size.y = 2 * most
    cone.size.z = length
    cone.color.CopyFrom(_colour(rgba))


def _ring(
    hub: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
    normal: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
    radius: float,
) -> list[tuple[float, float, float]]:
    side = np.cross(normal, (0.0, 0.0, 1.0))
    side /= np.linalg.norm(side)
    up = np.cross(side, normal)
    angles = np.linspace(0.0, 2 * math.pi, 73)
    return [tuple(hub + radius * (math.cos(a) * side + math.sin(a) * up)) for a in angles]
