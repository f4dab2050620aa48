"""The whole turbine: tapered tower, rounded nacelle, spinner, three blades. World ENU, metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from config.turbine import Turbine
from drivers.simulated.blade_mesh import blade_mesh
from drivers.simulated.mesh import Mesh, Part, cone, join, lattice
from drivers.simulated.rotor_frame import RotorFrame, rotor_frame
from drivers.simulated.scene import Scene
from perception.values import Float

_AROUND = 40
#: How far the blades' stubs reach into the hub, as a share of its radius.
_ROOT_INSIDE = 0.75
#: A rounded box: |y|^e + |z|^e = 1.
_BOX_EXPONENT = 4.0
_BEARING_GAP_M = 0.35


@dataclass(frozen=True, slots=True, eq=False)
class TurbineMeshes:
    """The parts that move together: the rotor turns with the nacelle and about its shaft."""

    rotor: Mesh
    nacelle: Mesh
    tower: Mesh


def turbine_meshes(scene: Scene) -> TurbineMeshes:
    """Return the turbine of a scene as it stands at mission time 0."""
    turbine, frame = scene.turbine, rotor_frame(scene)
    blades = [
        blade_mesh(turbine, frame.hub_w, blade, part)
        for blade, part in zip(
            frame.blades, (Part.BLADE_0, Part.BLADE_1, Part.BLADE_2), strict=True
        )
    ]
    return TurbineMeshes(
        rotor=join([*blades, *_hub(turbine, frame)]),
        nacelle=_nacelle(turbine, frame),
        tower=_tower(turbine, frame),
    )


def other_turbine(scene: Scene, bearing_rad: float, distance_m: float, up_m: float) -> Mesh:
    """Return a second turbine of the same type, for the background."""
    meshes = turbine_meshes(scene)
    whole = join([meshes.rotor, meshes.nacelle, meshes.tower])
    offset = np.array(
        [distance_m * np.sin(bearing_rad), distance_m * np.cos(bearing_rad), up_m], np.float32
    )
    return Mesh(
        vertices=whole.vertices + offset,
        triangles=whole.triangles,
        normals=whole.normals,
        metre=np.zeros_like(whole.metre),
        arc=np.zeros_like(whole.arc),
        part=np.full_like(whole.part, int(Part.OTHER_TURBINE)),
    )


def _shaft_height_m(turbine: Turbine, frame: RotorFrame) -> float:
    """Height of the shaft over the tower's axis: the tilt lifts the hub above it."""
    return float(frame.hub_w[2]) + turbine.overhang_m * float(frame.normal_w[2])


def _tower(turbine: Turbine, frame: RotorFrame) -> Mesh:
    bottom = _shaft_height_m(turbine, frame) - 0.5 * turbine.nacelle_height_m
    height = max(turbine.tower_height_m, bottom + _BEARING_GAP_M)
    height = min(height, bottom + turbine.nacelle_height_m * 0.5)
    return cone(
        np.array([0.0, 0.0, -1.0]),
        np.array([0.0, 0.0, height]),
        0.5 * turbine.tower_base_diameter_m,
        0.5 * turbine.tower_top_diameter_m,
        Part.TOWER,
        _AROUND,
    )


def _nacelle(turbine: Turbine, frame: RotorFrame) -> Mesh:
    """A level box with rounded edges behind the hub, narrowing to both ends."""
    back = -frame.upwind_level_w
    across = np.cross(back, (0.0, 0.0, 1.0))
    front = np.array([frame.hub_w[0], frame.hub_w[1], _shaft_height_m(turbine, frame)])
    front = front + 0.8 * turbine.hub_radius_m * back
    # share of length, share of the full section
    shares = (0.0, 0.0, 0.02, 0.08, 0.2, 0.85, 0.95, 0.99, 1.0, 1.0)
    sizes = (0.0, 0.55, 0.72, 0.9, 1.0, 1.0, 0.94, 0.86, 0.8, 0.0)
    turn = np.linspace(0.0, 2 * np.pi, _AROUND + 1)
    power = 2.0 / _BOX_EXPONENT
    y = np.sign(np.cos(turn)) * np.abs(np.cos(turn)) ** power * 0.5 * turbine.nacelle_width_m
    z = np.sign(np.sin(turn)) * np.abs(np.sin(turn)) ** power * 0.5 * turbine.nacelle_height_m
    rings = [
        front
        + share * turbine.nacelle_length_m * back
        + size * (np.outer(y, across) + np.outer(z, (0.0, 0.0, 1.0)))
        for share, size in zip(shares, sizes, strict=True)
    ]
    return lattice(np.stack(rings), Part.NACELLE)


def _hub(turbine: Turbine, frame: RotorFrame) -> list[Mesh]:
    """A spinner, blunt behind and rounded in front, and the stubs that carry the blades."""
    radius = 0.92 * turbine.hub_radius_m
    upwind = -frame.normal_w
    rings: list[Float] = []
    for share in np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 16)):
        length = 1.15 * radius if share > 0 else 0.8 * radius
        size = radius * np.sqrt(max(0.0, 1.0 - abs(float(share)) ** (2.0 if share > 0 else 6.0)))
        rings.append(_circle(frame.hub_w + share * length * upwind, upwind, size))
    spinner = lattice(np.stack(rings), Part.HUB)
    root = 0.5 * turbine.blade.chord_m[0]
    stubs = [
        cone(
            frame.hub_w + (1.0 - _ROOT_INSIDE) * turbine.hub_radius_m * blade.axis_w,
            frame.hub_w + turbine.hub_radius_m * blade.axis_w,
            1.04 * root,
            1.04 * root,
            Part.HUB,
            _AROUND,
        )
        for blade in frame.blades
    ]
    return [spinner, *stubs]


def _circle(centre: Float, axis: Float, radius_m: float) -> Float:
    helper = np.array([0.0, 0.0, 1.0])
    first = np.cross(axis, helper)
    first = first / np.linalg.norm(first)
    turn = np.linspace(0.0, 2 * np.pi, _AROUND + 1)[:, None]
    return np.asarray(
        centre + radius_m * (np.cos(turn) * first + np.sin(turn) * np.cross(axis, first)),
        np.float64,
    )
