"""The bench's pictures: repeatable, of every kind, and showing the scene's own rotor."""

import numpy as np
import pytest

from benchmarks.angle_baselines import Outcome, evaluate_line_fit, evaluate_vision
from benchmarks.angle_pictures import PictureOptions, take_picture
from benchmarks.angle_scenes import AngleScene, SceneOptions, make_scene
from benchmarks.picture_background import Backdrop
from benchmarks.picture_turbine import turbine_mesh
from drivers.simulated.mesh import Part
from perception.geometry import stop_angle_difference_deg

SMALL = PictureOptions(width_px=320, height_px=240)


@pytest.fixture(scope="module")
def scene() -> AngleScene:
    return make_scene(8002, SceneOptions(stand_off_m=(20.0, 30.0), prior_error_m=(0.0, 3.0)))


def test_the_same_seed_takes_the_same_picture(scene: AngleScene) -> None:
    one, again = take_picture(scene, 4, SMALL), take_picture(scene, 4, SMALL)
    assert one.backdrop is again.backdrop
    np.testing.assert_array_equal(one.grey, again.grey)
    assert not np.array_equal(one.grey, take_picture(scene, 5, SMALL).grey)


@pytest.mark.parametrize("backdrop", list(Backdrop))
def test_every_kind_of_background_is_drawn_with_contrast(
    scene: AngleScene, backdrop: Backdrop
) -> None:
    options = PictureOptions(width_px=320, height_px=240, backdrop=backdrop)
    picture = take_picture(scene, 3, options)
    assert picture.backdrop is backdrop
    assert picture.grey.shape == (240, 320)
    assert picture.grey.dtype == np.uint8
    assert picture.grey.std() > 8.0
    assert 20 < picture.grey.mean() < 220


def test_the_blades_of_the_mesh_point_where_the_truth_says(scene: AngleScene) -> None:
    mesh = turbine_mesh(scene, np.random.default_rng(1))
    down = -(scene.tower_down_w - (scene.tower_down_w @ scene.normal_w) * scene.normal_w)
    down = -down / np.linalg.norm(down)
    right = np.cross(down, scene.normal_w)
    for k in range(3):
        corners = mesh.triangles[mesh.part == int(Part(k))]
        rel = mesh.vertices[np.unique(corners)].mean(axis=0) - scene.hub_w
        angle = np.degrees(np.arctan2(rel @ right, rel @ down))
        off = (angle - scene.stop_angle_deg - 120 * k + 180) % 360 - 180
        assert abs(off) < 5.0  # prebend, droop and the chord behind the axis


def test_each_baseline_answers_a_scene_as_a_row(scene: AngleScene) -> None:
    for outcome in (evaluate_line_fit(scene), evaluate_vision(scene, seed=3)):
        assert isinstance(outcome, Outcome)
        assert outcome.seconds > 0
        if outcome.angle_deg is None:
            assert outcome.refusal
        else:
            assert abs(stop_angle_difference_deg(outcome.angle_deg, scene.stop_angle_deg)) < 10
