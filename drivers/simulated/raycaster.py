"""Rays against the synthetic world, and true distances to it. Embree through Open3D.

World ENU, metres. A standing turbine is one ray-casting scene with the ground; where nacelle or
rotor still move, they are scenes of their own into whose frames the rays are turned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from config.settings import Settings
from drivers.open3d_runtime import load_open3d
from drivers.simulated.mesh import Mesh, Part, join
from drivers.simulated.rotor_frame import rotor_frame
from drivers.simulated.scene import Scene
from drivers.simulated.terrain import ground_height_m, terrain_mesh
from drivers.simulated.turbine_mesh import other_turbine, turbine_meshes
from perception.values import Float, Float32

_NEIGHBOUR_M = 380.0
_FREE_OF_TREES_M = 30.0  # beyond the farthest launch place
NO_TRIANGLE = -1


class _Tensor(Protocol):
    def numpy(self) -> NDArray[np.float32]: ...


class _RaycastingScene(Protocol):
    """What is used of ``open3d.t.geometry.RaycastingScene``."""

    def add_triangles(self, vertices: object, triangles: object) -> object: ...

    def cast_rays(self, rays: object, nthreads: int) -> dict[str, _Tensor]: ...

    def compute_distance(self, points: object, nthreads: int) -> _Tensor: ...

    def test_occlusions(
        self, rays: object, tnear: float, tfar: float, nthreads: int
    ) -> _Tensor: ...


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """Where N rays end."""

    range_m: Float32
    """(N,) inf where nothing was hit."""
    triangle: NDArray[np.int32]
    """(N,) index into the caster's mesh, or `NO_TRIANGLE`."""
    uv: Float32
    """(N, 2) barycentric weights of the triangle's second and third vertex."""
    normal_w: Float32
    """(N, 3) of the triangle itself, unit."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A rigid motion since mission time 0: x -> rotation x + shift."""

    rotation: Float
    shift: Float


class _Group:
    """Triangles that move as one."""

    def __init__(self, mesh: Mesh, first_triangle: int) -> None:
        self.first_triangle = first_triangle
        self.scene = _scene_of(mesh)


def _scene_of(mesh: Mesh) -> _RaycastingScene:
    open3d = load_open3d()
    scene: _RaycastingScene = open3d.t.geometry.RaycastingScene()
    tensor = open3d.core.Tensor
    scene.add_triangles(tensor(mesh.vertices), tensor(mesh.triangles))
    return scene


class Raycaster:
    """The world of one scene, ready for rays."""

    def __init__(self, scene: Scene, settings: Settings, threads: int = 1) -> None:
        self._tensor = load_open3d().core.Tensor
        self._threads = threads
        self._frame = rotor_frame(scene)
        truth = settings.simulation.truth
        self._rotor_rps = math.radians(truth.rotor_rate_dps)
        self._yaw_rps = math.radians(truth.yaw_rate_dps)
        self.moving = self._rotor_rps != 0.0 or self._yaw_rps != 0.0
        meshes = turbine_meshes(scene)
        fixed = join([meshes.tower, _surroundings(scene, settings.simulation.seed)])
        self.mesh = join([meshes.rotor, meshes.nacelle, fixed])
        """Everything, as it stands at mission time 0."""
        parts = [meshes.rotor, meshes.nacelle, fixed] if self.moving else [self.mesh]
        counts = np.cumsum([0, *(len(part.triangles) for part in parts)])
        self._groups = [
            _Group(part, int(first)) for part, first in zip(parts, counts[:-1], strict=True)
        ]
        obstacles = _without_ground(fixed)
        solid = (
            [meshes.rotor, meshes.nacelle, obstacles]
            if self.moving
            else [join([meshes.rotor, meshes.nacelle, obstacles])]
        )
        self._solid = [_scene_of(mesh) for mesh in solid]

    def motions(self, t_s: float) -> tuple[Motion, Motion, Motion]:
        """Return how rotor, nacelle and everything else have moved since mission time 0."""
        still = Motion(np.eye(3), np.zeros(3))
        if not self.moving:
            return still, still, still
        yaw = _about(np.array([0.0, 0.0, -1.0]), self._yaw_rps * t_s)
        # Counter-clockwise for a viewer in front, so that the stop angle grows.
        turn = _about(-self._frame.normal_w, self._rotor_rps * t_s)
        hub = self._frame.hub_w
        return Motion(yaw @ turn, yaw @ (hub - turn @ hub)), Motion(yaw, np.zeros(3)), still

    def cast(self, origins_w: Float32, directions_w: Float32, t_s: float) -> Hits:
        """Return where rays from (N, 3) origins along (N, 3) unit directions end."""
        if not self.moving:
            return self._cast_group(self._groups[0], origins_w, directions_w, None)
        first, *others = (
            self._cast_group(group, origins_w, directions_w, motion)
            for group, motion in zip(self._groups, self.motions(t_s), strict=True)
        )
        for other in others:
            nearer = other.range_m < first.range_m
            first = Hits(
                np.where(nearer, other.range_m, first.range_m),
                np.where(nearer, other.triangle, first.triangle),
                np.where(nearer[:, None], other.uv, first.uv),
                np.where(nearer[:, None], other.normal_w, first.normal_w),
            )
        return first

    def clearance_m(self, points_w: Float32, t_s: float) -> Float32:
        """Return the true distance of (N, 3) points to turbine and obstacles (not the ground)."""
        if not self.moving:
            return self._solid[0].compute_distance(self._tensor(points_w), self._threads).numpy()
        distances = [
            scene.compute_distance(self._tensor(_into(points_w, motion)), self._threads).numpy()
            for scene, motion in zip(self._solid, self.motions(t_s), strict=True)
        ]
        return np.asarray(np.min(distances, axis=0), np.float32)

    def _cast_group(
        self, group: _Group, origins_w: Float32, directions_w: Float32, motion: Motion | None
    ) -> Hits:
        rays = np.empty((len(origins_w), 6), np.float32)
        rays[:, :3] = origins_w if motion is None else _into(origins_w, motion)
        rays[:, 3:] = directions_w if motion is None else directions_w @ motion.rotation
        answer = group.scene.cast_rays(self._tensor(rays), self._threads)
        range_m = answer["t_hit"].numpy()
        triangle = answer["primitive_ids"].numpy().astype(np.int32)
        triangle += np.int32(group.first_triangle)
        triangle[np.isinf(range_m)] = NO_TRIANGLE
        normal = answer["primitive_normals"].numpy()
        if motion is not None:
            normal = (normal @ motion.rotation.T).astype(np.float32)
        return Hits(range_m, triangle, answer["primitive_uvs"].numpy(), normal)


def _surroundings(scene: Scene, seed: int) -> Mesh:
    """Ground, trees and buildings, and another turbine in the distance."""
    launch_m = math.hypot(scene.launch_w[0], scene.launch_w[1])
    clear_m = max(launch_m, scene.turbine.rotor_radius_m) + _FREE_OF_TREES_M
    bearing = float(np.random.default_rng([seed, 0x2E]).uniform(0.0, 2 * math.pi))
    east, north = _NEIGHBOUR_M * math.sin(bearing), _NEIGHBOUR_M * math.cos(bearing)
    up_m = ground_height_m(east, north, seed)
    return join([terrain_mesh(seed, clear_m), other_turbine(scene, bearing, _NEIGHBOUR_M, up_m)])


def _without_ground(mesh: Mesh) -> Mesh:
    keep = mesh.part != int(Part.GROUND)
    return Mesh(
        mesh.vertices, mesh.triangles[keep], mesh.normals, mesh.metre, mesh.arc, mesh.part[keep]
    )


def _into(points_w: Float32, motion: Motion) -> Float32:
    """Return (N, 3) points as they would lie had the group not moved."""
    return ((points_w - motion.shift) @ motion.rotation).astype(np.float32)


def _about(axis: Float, angle_rad: float) -> Float:
    """Return the rotation about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(
        np.eye(3) + math.sin(angle_rad) * cross + (1.0 - math.cos(angle_rad)) * (cross @ cross),
        np.float64,
    )
