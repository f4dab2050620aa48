from __future__ import annotations

import numpy as np
import pytest

from config.settings import Settings
from config.simulation import Simulation, TruthDraws, Wind
from config.turbine import Site
from drivers.simulated.scene import Scene, draw_scene


def drawn(seed: int, truth: TruthDraws | None = None, wind: Wind | None = None) -> Scene:
    simulation = Simulation(seed=seed, truth=truth or TruthDraws(), wind=wind or Wind())
    site = Site(name="t", turbine="nrel-5mw", scale=0.5)
    return draw_scene(Settings(sites=(site,), simulation=simulation))


def test_the_same_seed_draws_the_same_scene_and_another_seed_another() -> None:
    assert drawn(5) == drawn(5)
    assert drawn(5) != drawn(6)


def test_fixing_one_value_leaves_the_others_as_they_were() -> None:
    free, fixed = drawn(9), drawn(9, TruthDraws(stop_angle_deg=119.95))
    assert fixed.stop_angle_deg == 119.95
    assert fixed.launch_w == free.launch_w
    assert fixed.pitch_deg == free.pitch_deg


def test_draws_stay_within_what_the_design_says() -> None:
    for seed in range(60):
        scene = drawn(seed)
        assert 0.0 <= scene.stop_angle_deg < 120.0
        away = float(np.hypot(*scene.launch_w[:2])) - scene.turbine.rotor_radius_m
        assert 20.0 <= away <= 45.0
        assert float(np.hypot(*scene.prior_error_m[:2])) <= 5.0
        assert 2.0 <= scene.wind_mean_mps <= 8.0
        assert max(scene.pitch_deg) - min(scene.pitch_deg) <= 2.0


def test_pitch_is_fine_feathered_or_between_in_the_shares_of_the_field() -> None:
    pitch = np.array([np.mean(drawn(seed).pitch_deg) for seed in range(400)])
    assert np.mean(pitch < 6.0) == pytest.approx(0.40, abs=0.08)
    assert np.mean(pitch > 81.0) == pytest.approx(0.45, abs=0.08)


def test_the_rotor_roughly_faces_the_wind_whichever_is_given() -> None:
    for seed in range(20):
        for truth, wind in (
            (None, None),
            (TruthDraws(nacelle_yaw_deg=350.0), None),
            (None, Wind(direction_deg=5.0)),
        ):
            scene = drawn(seed, truth, wind)
            error = (scene.nacelle_yaw_deg - scene.wind_from_deg + 180.0) % 360.0 - 180.0
            assert abs(error) <= 10.0
