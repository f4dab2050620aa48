import math

import pytest

from config.scenarios import scenario_path
from config.sources import load_settings
from drivers.simulated.scene import draw_scene


@pytest.mark.parametrize(("scenario", "off_deg"), [("crosswind", 90.0), ("behind", 180.0)])
@pytest.mark.parametrize("seed", range(1, 6))
def test_the_launch_lies_where_the_scenario_says_whatever_the_seed(scenario, off_deg, seed):
    settings = load_settings([scenario_path(scenario)], [f"simulation.seed={seed}"], {})
    scene = draw_scene(settings)
    bearing_deg = math.degrees(math.atan2(scene.launch_w[0], scene.launch_w[1]))
    from_rotor_deg = (bearing_deg - scene.nacelle_yaw_deg) % 360.0
    assert from_rotor_deg == pytest.approx(off_deg)
