from __future__ import annotations

import math

import numpy as np
import pytest

from config.settings import Settings
from config.simulation import Simulation, TruthDraws
from config.turbine import Site
from drivers.simulated.rotor_frame import blade_names, rotor_frame
from drivers.simulated.scene import draw_scene
from perception.rotor import angle_of, blade_angles_deg, direction_at

DOWN = np.array([0.0, 0.0, -1.0])


def settings_with(**truth: float) -> Settings:
    return Settings(
        sites=(Site(name="t", turbine="iea-3.4-130", scale=0.6),),
        simulation=Simulation(seed=3, truth=TruthDraws(pitch_spread_deg=0.0, **truth)),
    )


@pytest.mark.parametrize("stop_deg", [0.0, 33.0, 60.0, 119.95])
def test_blades_point_where_perceptions_definition_says(stop_deg: float) -> None:
    scene = draw_scene(settings_with(stop_angle_deg=stop_deg))
    frame = rotor_frame(scene)
    for k, blade in enumerate(frame.blades):
        angle = math.radians(stop_deg + 120.0 * k)
        expected = direction_at(angle, frame.normal_w, DOWN, math.radians(scene.cone_deg))
        np.testing.assert_allclose(blade.axis_w, expected, atol=1e-12)
    first = math.degrees(angle_of(frame.blades[0].axis_w, frame.normal_w, DOWN))
    assert first == pytest.approx(stop_deg, abs=1e-6)


def test_the_rotor_faces_its_yaw_and_is_tilted_up() -> None:
    frame = rotor_frame(draw_scene(settings_with(nacelle_yaw_deg=90.0)))
    assert frame.hub_w[0] > 0.5
    assert abs(frame.hub_w[1]) < 1e-9
    assert frame.normal_w[0] < -0.9  # downwind of a rotor that faces east is west
    assert frame.normal_w[2] < 0.0


def test_at_pitch_0_the_pressure_side_is_upwind_and_the_leading_edge_ahead() -> None:
    frame = rotor_frame(draw_scene(settings_with(pitch_deg=0.0)))
    for blade in frame.blades:
        assert blade.pressure_w() @ -frame.normal_w > 0.99
        # Clockwise seen from upwind: about the normal, which points away from the viewer.
        ahead = np.cross(frame.normal_w, blade.axis_w)
        assert blade.leading_w() @ ahead > 0.99


def test_feathered_the_leading_edge_is_upwind() -> None:
    frame = rotor_frame(draw_scene(settings_with(pitch_deg=90.0)))
    for blade in frame.blades:
        assert blade.leading_w() @ -frame.normal_w > 0.99
        assert abs(blade.pressure_w() @ frame.normal_w) < 0.05


@pytest.mark.parametrize("stop_deg", [0.0, 50.0, 74.9, 75.1, 100.0, 119.9])
def test_names_follow_the_positions_of_the_definition(stop_deg: float) -> None:
    angles = dict(zip("ABC", blade_angles_deg(stop_deg), strict=True))
    for k, name in enumerate(blade_names(stop_deg)):
        difference = (angles[name] - (stop_deg + 120.0 * k) + 180.0) % 360.0 - 180.0
        assert abs(difference) < 1e-9
