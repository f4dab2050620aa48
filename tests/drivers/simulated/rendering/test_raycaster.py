from __future__ import annotations

import math

import numpy as np
import pytest

from config.settings import Settings
from config.simulation import TruthDraws
from drivers.simulated.mesh import Part
from drivers.simulated.raycaster import NO_TRIANGLE, Raycaster
from drivers.simulated.rotor_frame import rotor_frame
from drivers.simulated.scene import Scene


def test_rays_find_tower_ground_and_sky_at_their_distances(caster: Raycaster, scene: Scene) -> None:
    eye = np.array([[30.0, 0.0, 20.0]] * 3, np.float32)
    ways = np.array([[-1, 0, 0], [0, 0, -1], [0, 0, 1]], np.float32)
    hits = caster.cast(eye, ways, 0.0)
    radius = scene.turbine.tower_base_diameter_m / 2
    assert hits.range_m[0] == pytest.approx(30.0 - radius, abs=0.7)  # it tapers
    assert caster.mesh.part[hits.triangle[0]] == Part.TOWER
    assert hits.range_m[1] == pytest.approx(20.0, abs=1.0)
    assert caster.mesh.part[hits.triangle[1]] == Part.GROUND
    assert np.isinf(hits.range_m[2])
    assert hits.triangle[2] == NO_TRIANGLE


def test_clearance_counts_turbine_and_obstacles_but_not_the_ground(caster: Raycaster) -> None:
    points = np.array([[20.0, 0.0, 1.0]], np.float32)
    assert caster.clearance_m(points, 0.0)[0] > 15.0


def test_a_moving_rotor_is_hit_where_it_has_turned_to(settings: Settings, scene: Scene) -> None:
    frame = rotor_frame(scene)
    truth = TruthDraws(**{**settings.simulation.truth.model_dump(), "rotor_rate_dps": 2.0})
    moving = settings.model_copy(
        update={"simulation": settings.simulation.model_copy(update={"truth": truth})}
    )
    caster = Raycaster(scene, moving)
    down = np.array([0.0, 0.0, -1.0])
    down = down - (down @ frame.normal_w) * frame.normal_w
    down = down / np.linalg.norm(down)
    right = np.cross(frame.normal_w, -down)
    for t_s, stop_deg in ((0.0, 20.0), (10.0, 40.0)):
        angle = math.radians(stop_deg)
        spot = frame.hub_w + 15.0 * (math.cos(angle) * down + math.sin(angle) * right)
        eye = (spot - 15.0 * frame.normal_w).astype(np.float32)[None]
        hits = caster.cast(eye, frame.normal_w.astype(np.float32)[None], t_s)
        assert caster.mesh.part[hits.triangle[0]] == Part.BLADE_0
        assert hits.normal_w[0] @ frame.normal_w < -0.7
        elsewhere = caster.cast(eye, frame.normal_w.astype(np.float32)[None], t_s + 7.0)
        assert elsewhere.triangle[0] == NO_TRIANGLE or (
            caster.mesh.part[elsewhere.triangle[0]] != Part.BLADE_0
        )
        assert caster.clearance_m(eye, t_s)[0] < 16.0
