"""One small turbine at the operating stop, in front of which everything is drawn."""

from __future__ import annotations

import pytest

from config.settings import Settings
from config.simulation import Simulation, TruthDraws
from config.turbine import Site
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.scene import Scene, draw_scene


@pytest.fixture(scope="session")
def settings() -> Settings:
    truth = TruthDraws(
        pitch_spread_deg=0.0, stop_angle_deg=20.0, pitch_deg=0.0, nacelle_yaw_deg=30.0
    )
    return Settings(
        sites=(Site(name="t", turbine="iea-3.4-130", scale=0.6),),
        simulation=Simulation(seed=3, truth=truth),
    )


@pytest.fixture(scope="session")
def scene(settings: Settings) -> Scene:
    return draw_scene(settings)


@pytest.fixture(scope="session")
def caster(scene: Scene, settings: Settings) -> Raycaster:
    return Raycaster(scene, settings)
