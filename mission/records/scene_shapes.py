"""Shapes of a Foxglove scene: lines, balls, cones and rings in the world, metres."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from google.protobuf.timestamp_pb2 import Timestamp

from mission.flight.observation import Vec3
from perception.geometry import quaternion_from_rotation, vec3
from perception.values import Float

Rgba: TypeAlias = tuple[float, float, float, float]


def stamp_of(nanoseconds: int) -> Timestamp:
    """Return a time as Protobuf tells it."""
    seconds, nanos = divmod(nanoseconds, 1_000_000_000)
    return Timestamp(seconds=seconds, nanos=nanos)


def entity_of(name: str, now_ns: int) -> SceneEntity:
    """Return an empty entity; a later one of the same name takes its place."""
    return SceneEntity(timestamp=stamp_of(now_ns), frame_id="world", id=name)


def colour_of(rgba: Rgba) -> Color:
    """Return a colour of red, green, blue and opacity, 0 to 1."""
    return Color(r=rgba[0], g=rgba[1], b=rgba[2], a=rgba[3])


def place_at(
    pose: Pose, place: Sequence[float], turn: Sequence[float] = (1.0, 0.0, 0.0, 0.0)
) -> None:
    """Fill a foxglove.Pose: metres; w x y z."""
    position, orientation = pose.position, pose.orientation
    position.x, position.y, position.z = (float(v) for v in place)
    orientation.w, orientation.x, orientation.y, orientation.z = (float(v) for v in turn)


def add_line(
    entity: SceneEntity, points: Sequence[Sequence[float]], rgba: Rgba, wide_m: float
) -> None:
    """Add a polyline through points (x, y, z)."""
    line = entity.lines.add(thickness=wide_m)
    line.pose.orientation.w = 1.0
    line.color.CopyFrom(colour_of(rgba))
    for x, y, z in points:
        line.points.add(x=float(x), y=float(y), z=float(z))


def add_ball(entity: SceneEntity, place: Sequence[float], wide_m: float, rgba: Rgba) -> None:
    """Add a ball of a diameter."""
    ball = entity.spheres.add()
    place_at(ball.pose, place)
    ball.size.x = ball.size.y = ball.size.z = wide_m
    ball.color.CopyFrom(colour_of(rgba))


def add_cone(
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
    place_at(cone.pose, tuple((first + second) / 2), tuple(turn))
    cone.size.x = cone.size.y = 2 * most
    cone.size.z = length
    cone.color.CopyFrom(colour_of(rgba))


def ring_of(hub: Float, normal: Float, radius: float) -> list[Vec3]:
    """Return the points of a circle about a hub (3,), in the plane of a normal (3,)."""
    side = np.cross(normal, (0.0, 0.0, 1.0))
    side /= np.linalg.norm(side)
    up = np.cross(side, normal)
    angles = np.linspace(0.0, 2 * math.pi, 73)
    return [vec3(hub + radius * (math.cos(a) * side + math.sin(a) * up)) for a in angles]
