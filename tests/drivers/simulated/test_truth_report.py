import json

from config.settings import Settings
from config.turbine import Site
from drivers.simulated.ned import Home
from drivers.simulated.scene import draw_scene
from drivers.simulated.told import write_told
from drivers.simulated.truth_report import Nearness, WorldFacts, truth_of

FACTS = WorldFacts(
    mission_s=300.0,
    setpoint_gap_ms={"p99": 60.0},
    setpoint_gap_wall_ms={"p99": 20.0},
    setpoints=10,
    offboard_losses=0,
    landed=True,
    armed=False,
    took_off=True,
    touchdown_mps=0.7,
    wind_mean_mps=5.0,
    wind_from_deg=200.0,
    wind_max_mps=7.0,
    battery_left=0.6,
    energy_wh=200.0,
    landing_error_m=0.4,
    link={"sent": 1},
    faults=[],
)


def test_the_judgement_stands_beside_the_worlds_own_truth():
    truth = truth_of('{"stop_angle_deg": 12.0}', FACTS, Nearness(0.9), wall_s=100.0)
    assert truth["stop_angle_deg"] == 12.0
    assert truth["timing"]["real_time_factor"] == 3.0
    assert truth["timing"]["setpoint_gap_ms"]["p99"] == 60.0
    assert truth["vehicle"]["collisions"] == 0
    assert json.dumps(truth)


def test_a_collision_is_counted_once_for_each_touch():
    near = Nearness(0.9)
    for t_s, clearance_m in enumerate((9.0, 0.5, 0.4, 3.0, 0.8)):
        near.note(t_s, clearance_m)
    assert near.collisions == 2
    assert near.least_m == 0.4 - 0.9
    assert near.least_at_s == 2


def test_the_mission_is_told_the_prior_and_nothing_of_the_truth(tmp_path):
    settings = Settings(sites=(Site(name="t", turbine="nrel-5mw", scale=0.5),))
    scene = draw_scene(settings)
    write_told(tmp_path / "told.json", settings, scene, Home(54.0, 6.0, 20.0))
    told = json.loads((tmp_path / "told.json").read_text())
    assert set(told) == {"site", "home"}
    assert Site.model_validate(told["site"]).nacelle_yaw_deg is None
    east = told["site"]["tower_east_m"] + scene.launch_w[0]
    assert east == scene.prior_error_m[0] or abs(east - scene.prior_error_m[0]) < 1e-9
    text = json.dumps(told)
    for secret in (scene.stop_angle_deg, scene.nacelle_yaw_deg, *scene.pitch_deg):
        assert f"{secret:.4f}" not in text
