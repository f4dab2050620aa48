"""The mesh of a scene's turbine, for pictures: smooth normals, in the frame of its points."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.angle_scenes import AngleScene
from benchmarks.blade_family import blade_mesh
from drivers.simulated.mesh import Mesh, Part, build, cone, join, lattice, ring
from perception.rotor import direction_at
from perception.values import Float

_BLADES = (Part.BLADE_0, Part.BLADE_1, Part.BLADE_2)


def turbine_mesh(scene: AngleScene, rng: np.random.Generator) -> Mesh:
    """Return the turbine: blades as in the scene, first; then spinner, nacelle, tower.

    The blades' spacing errors and the tower's girth, which a scene does not keep, are drawn anew.
    """
    hub, normal, down = scene.hub_w, scene.normal_w, scene.tower_down_w
    cone_rad = math.radians(scene.turbine.cone_deg)
    parts = []
    for k, part in enumerate(_BLADES):
        angle = math.radians(scene.stop_angle_deg + 120 * k + rng.uniform(-0.2, 0.2))
        z = direction_at(angle, normal, down, cone_rad)
        x = direction_at(angle + math.pi / 2, normal, down)
        y = np.cross(z, x)
        y = y if y @ normal > 0 else -y
        vertices, faces = blade_mesh(
            scene.plan, scene.pitch_deg[k], (float(-x[2]), float(-y[2])), 1.0
        )
        placed = hub + vertices @ np.stack([x, y, z])
        metre = np.asarray(vertices[:, 2] - scene.plan.hub_radius_m, np.float64)
        parts.append(build(placed, _outward(placed, faces), part, metre))
    return join([*parts, *_middle(scene, rng), _tower(scene, rng)])


def _outward(vertices: Float, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the faces, turned where the closed mesh's volume comes out negative."""
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)))
    return faces if volume > 0 else faces[:, ::-1]


def _middle(scene: AngleScene, rng: np.random.Generator) -> list[Mesh]:
    """Spinner and nacelle."""
    hub, normal, plan = scene.hub_w, scene.normal_w, scene.plan
    radius = plan.hub_radius_m + 0.25 * float(plan.chord_m[0])
    rings = []
    for share in np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 16)):
        along = (-1.25 if share > 0 else -0.8) * radius * share
        size = radius * math.sqrt(max(0.0, 1 - abs(float(share)) ** (2.0 if share > 0 else 6.0)))
        rings.append(ring(hub + along * normal, normal, max(size, 1e-3), 40))
    level = normal * [1, 1, 0]
    level = level / np.linalg.norm(level)
    across = np.cross(level, (0.0, 0.0, 1.0))
    width, height = 0.05 * plan.length_m + 0.8, 0.05 * plan.length_m + rng.uniform(0.6, 1.6)
    length = scene.turbine.overhang_m + rng.uniform(4.0, 9.0)
    turn = np.linspace(0, 2 * np.pi, 41)
    y = np.sign(np.cos(turn)) * np.abs(np.cos(turn)) ** 0.4 * 0.5 * width
    z = np.sign(np.sin(turn)) * np.abs(np.sin(turn)) ** 0.4 * 0.5 * height
    box = [
        hub
        + (0.85 * radius + share * length) * level
        + size * (np.outer(y, across) + np.outer(z, (0.0, 0.0, 1.0)))
        for share, size in ((0, 0.01), (0, 0.8), (0.05, 0.97), (0.8, 1.0), (1, 0.85), (1, 0.01))
    ]
    return [lattice(np.stack(rings), Part.HUB), lattice(np.stack(box), Part.NACELLE)]


def _tower(scene: AngleScene, rng: np.random.Generator) -> Mesh:
    top = scene.hub_w + scene.turbine.overhang_m * scene.normal_w - np.array([0, 0, 1.5])
    foot = top + scene.tower_down_w * (top[2] + 2.0) / -float(scene.tower_down_w[2])
    radius = rng.uniform(0.018, 0.026) * scene.plan.length_m + 0.3
    return cone(foot, top, radius * rng.uniform(1.4, 1.9), radius, Part.TOWER, 60)
