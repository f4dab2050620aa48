from __future__ import annotations

import numpy as np
import pytest

from config.presets import load_turbine
from drivers.simulated.blade_mesh import blade_mesh, droop
from drivers.simulated.mesh import Mesh, Part
from drivers.simulated.rotor_frame import BladeFrame, rotor_frame
from drivers.simulated.scene import Scene
from drivers.simulated.turbine_mesh import turbine_meshes

BLADES = (Part.BLADE_0, Part.BLADE_1, Part.BLADE_2)


def vertices_of(mesh: Mesh, part: Part) -> np.ndarray:
    return np.unique(mesh.triangles[mesh.part == part])


@pytest.fixture(scope="module")
def rotor(scene: Scene) -> Mesh:
    return turbine_meshes(scene).rotor


def test_each_blades_root_lies_on_the_defined_axis_and_its_length_along_it(
    scene: Scene, rotor: Mesh
) -> None:
    frame = rotor_frame(scene)
    for part, blade in zip(BLADES, frame.blades, strict=True):
        rows = vertices_of(rotor, part)
        points = rotor.vertices[rows].astype(float)
        circle = np.unique(points[rotor.metre[rows] == 0.0].round(4), axis=0)
        root = circle.mean(axis=0) - frame.hub_w
        assert root / np.linalg.norm(root) @ blade.axis_w > 0.9999
        assert np.linalg.norm(root) == pytest.approx(scene.turbine.hub_radius_m, abs=0.05)
        _, _, principal = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
        # Sweep of the chord, prebend and droop turn the cloud's own axis a little.
        assert abs(principal[0] @ blade.axis_w) > np.cos(np.radians(3.0))


def test_at_pitch_0_the_suction_side_faces_downwind_and_arc_0_is_the_leading_edge(
    scene: Scene, rotor: Mesh
) -> None:
    frame = rotor_frame(scene)
    for part, blade in zip(BLADES, frame.blades, strict=True):
        rows = vertices_of(rotor, part)
        outer = rows[np.abs(rotor.metre[rows] - 0.6 * scene.turbine.blade_length_m) < 1.0]
        suction = outer[(rotor.arc[outer] < -0.3)]
        pressure = outer[(rotor.arc[outer] > 0.3)]
        assert np.mean(rotor.normals[suction] @ frame.normal_w) > 0.7
        assert np.mean(rotor.normals[pressure] @ frame.normal_w) < -0.7
        leading = outer[np.abs(rotor.arc[outer]) < 0.02]
        clockwise = np.cross(frame.normal_w, blade.axis_w)
        assert np.mean(rotor.normals[leading] @ clockwise) > 0.85
        middle = rotor.vertices[outer].mean(axis=0)
        assert np.mean((rotor.vertices[leading] - middle) @ clockwise) > 0.3


def test_normals_point_outward(scene: Scene, rotor: Mesh) -> None:
    corners = rotor.vertices[rotor.triangles].astype(float) - rotor_frame(scene).hub_w
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for part in BLADES:
        # The divergence theorem: a skin that faces outward encloses a positive volume.
        blade = rotor.part == part
        assert float(np.sum(corners[blade, 0] * faces[blade])) / 6.0 > 1.0


def horizontal_blade(pitch_rad: float) -> BladeFrame:
    """A blade that points east on a rotor that faces north."""
    return BladeFrame(
        axis_w=np.array([1.0, 0.0, 0.0]),
        towards_rotation_w=np.array([0.0, 0.0, 1.0]),
        upwind_w=np.array([0.0, 1.0, 0.0]),
        pitch_rad=pitch_rad,
    )


def test_a_feathered_horizontal_blade_sags_as_such_blades_do() -> None:
    feathered = horizontal_blade(np.pi / 2)
    for length_m, low, high in ((60.0, 0.85, 0.95), (80.0, 1.4, 1.6), (35.0, 0.2, 0.5)):
        tip = droop(length_m, feathered, np.array([0.0, 1.0]))[1]
        assert low <= -tip[2] <= high
        assert np.hypot(tip[0], tip[1]) < 1e-9


def test_edgewise_it_sags_less_and_upright_not_at_all() -> None:
    flat = droop(60.0, horizontal_blade(0.0), np.array([1.0]))[0]
    feathered = droop(60.0, horizontal_blade(np.pi / 2), np.array([1.0]))[0]
    assert 0.0 < -flat[2] < 0.5 * -feathered[2]
    upright = BladeFrame(
        np.array([0.0, 0.0, 1.0]), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), 1.0
    )
    assert np.allclose(droop(60.0, upright, np.array([1.0])), 0.0)


def test_the_skin_has_the_published_chord_and_thickness() -> None:
    turbine = load_turbine("iea-3.4-130")
    frame = horizontal_blade(0.0)
    mesh = blade_mesh(turbine, np.zeros(3), frame, Part.BLADE_0)
    for share in (0.0, 0.3, 0.7):
        metres = np.unique(mesh.metre)
        station = metres[np.argmin(np.abs(metres - share * turbine.blade_length_m))]
        ring = mesh.vertices[mesh.metre == station].astype(float)
        span = station / turbine.blade_length_m
        twist = np.radians(np.interp(span, turbine.blade.span, turbine.blade.twist_deg))
        across = ring @ frame.leading_w(twist)
        chord = np.interp(span, turbine.blade.span, turbine.blade.chord_m)
        assert np.ptp(across) == pytest.approx(chord, rel=0.02)
        thick = np.ptp(ring @ frame.pressure_w(twist)) / chord
        assert thick == pytest.approx(
            np.interp(span, turbine.blade.span, turbine.blade.thickness), abs=0.06
        )


def test_tower_nacelle_and_hub_stand_where_they_belong(scene: Scene) -> None:
    meshes, turbine = turbine_meshes(scene), scene.turbine
    top = meshes.tower.vertices[:, 2].max()
    assert np.hypot(*meshes.tower.vertices[:, :2].T).max() == pytest.approx(
        turbine.tower_base_diameter_m / 2, rel=0.01
    )
    assert meshes.nacelle.vertices[:, 2].min() < top < meshes.nacelle.vertices[:, 2].max()
    frame = rotor_frame(scene)
    behind = (meshes.nacelle.vertices - frame.hub_w) @ -frame.upwind_level_w
    assert behind.min() > 0.0
