"""Triangle meshes with what a sensor needs to know of each point: part, blade metre, arc.

World ENU, metres, float32: the ray caster's own precision (0.02 mm at 200 m).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from perception.values import Bytes, Float, Float32


class Part(IntEnum):
    """What a triangle belongs to. The blades stand at the stop angle + 0, 120, 240 deg."""

    BLADE_0 = 0
    BLADE_1 = 1
    BLADE_2 = 2
    TOWER = 3
    NACELLE = 4
    HUB = 5
    GROUND = 6
    TREE = 7
    BUILDING = 8
    OTHER_TURBINE = 9
    SKY = 10
    """No triangle: the ray left the world."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles with outward normals."""

    vertices: Float32
    """(V, 3)"""
    triangles: NDArray[np.uint32]
    """(T, 3) counter-clockwise seen from outside."""
    normals: Float32
    """(V, 3) unit, smoothed over the triangles that share the vertex."""
    metre: Float32
    """(V,) blade metre from the root flange along the pitch axis; 0 off the blades."""
    arc: Float32
    """(V,) metres along the section's skin from the leading edge, positive on the pressure side."""
    part: Bytes
    """(T,) `Part`"""


def join(meshes: Sequence[Mesh]) -> Mesh:
    """Return one mesh of several."""
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    triangles = [
        mesh.triangles + np.uint32(offset) for mesh, offset in zip(meshes, offsets, strict=True)
    ]
    return Mesh(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        triangles=np.concatenate(triangles),
        normals=np.concatenate([mesh.normals for mesh in meshes]),
        metre=np.concatenate([mesh.metre for mesh in meshes]),
        arc=np.concatenate([mesh.arc for mesh in meshes]),
        part=np.concatenate([mesh.part for mesh in meshes]),
    )


def build(
    vertices: Float,
    triangles: NDArray[np.int64],
    part: Part,
    metre: Float | None = None,
    arc: Float | None = None,
) -> Mesh:
    """Return a mesh with smoothed normals from (V, 3) vertices and (T, 3) indices."""
    corners = vertices[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    for column in range(3):
        np.add.at(normals, triangles[:, column], faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.where(length > 0.0, length, 1.0)
    zeros = np.zeros(len(vertices))
    return Mesh(
        vertices=vertices.astype(np.float32),
        triangles=triangles.astype(np.uint32),
        normals=normals.astype(np.float32),
        metre=(zeros if metre is None else metre).astype(np.float32),
        arc=(zeros if arc is None else arc).astype(np.float32),
        part=np.full(len(triangles), int(part), np.uint8),
    )


def lattice(
    grid: Float,
    part: Part,
    *,
    outward: Float | None = None,
    metre: Float | None = None,
    arc: Float | None = None,
) -> Mesh:
    """Return the surface through an (R, C, 3) grid of points.

    Normals point along ``outward`` (3,) where it is given, otherwise away from each row's mean:
    right for rings stacked along an axis. ``metre`` and ``arc``: (R, C).
    """
    rows, columns = grid.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    triangles = np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )
    vertices = grid.reshape(-1, 3)
    corners = vertices[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if outward is None:
        middle = np.repeat(grid.mean(axis=1), columns, axis=0)
        away = corners.mean(axis=1) - middle[triangles].mean(axis=1)
    else:
        away = np.broadcast_to(outward, faces.shape)
    if float(np.sum(faces * away)) < 0.0:
        triangles = triangles[:, ::-1]
    flat_metre = None if metre is None else metre.ravel()
    return build(vertices, triangles, part, flat_metre, None if arc is None else arc.ravel())


def ring(centre: Float, axis: Float, radius_m: float, count: int) -> Float:
    """Return (count + 1, 3) points of a closed circle about an axis (the first is repeated)."""
    helper = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    first = np.cross(axis, helper)
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    angle = np.linspace(0.0, 2 * np.pi, count + 1)[:, None]
    circle: Float = centre + radius_m * (np.cos(angle) * first + np.sin(angle) * second)
    return circle


def cone(
    foot: Float, top: Float, foot_radius_m: float, top_radius_m: float, part: Part, count: int
) -> Mesh:
    """Return the side of a truncated cone, cut into rings about 3 m apart where it is long."""
    axis = (top - foot) / np.linalg.norm(top - foot)
    rows = max(2, min(40, int(np.linalg.norm(top - foot) / 3.0)))
    share = np.linspace(0.0, 1.0, rows)
    rings = [
        ring(
            foot + s * (top - foot), axis, foot_radius_m + s * (top_radius_m - foot_radius_m), count
        )
        for s in share
    ]
    return lattice(np.stack(rings), part)
