"""A recorded cloud tells its rotor, whatever else is in it, or says what it misses."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.angle_scenes import make_scene
from config.presets import load_turbine
from config.settings import Settings
from perception.cloud_estimate import Question, estimate_cloud
from perception.geometry import lidar_in_body, stop_angle_difference_deg
from perception.recorded_cloud import RecordedCloud, UnusableCloud
from perception.rotor import Refusal, RefusalCode

FOLDER = Path(__file__).parents[1] / "clouds"
TRUTH = json.loads((FOLDER / "truth.json").read_text())
HUB = np.array(TRUTH["hub_m"])
NORMAL = np.array(TRUTH["normal"])
EYE = np.array(TRUTH["viewpoint_m"])
FERMAT = Settings.model_validate({"estimation": {"method": "fermat"}})


def ascent():
    with np.load(FOLDER / "ascent.npz") as file:
        return RecordedCloud(
            file["points"].astype(float), file["viewpoint"].astype(float), file["time_s"]
        )


def hover():
    cloud = ascent()
    late = cloud.time_s > 18.0
    return RecordedCloud(cloud.points_w[late], EYE)


def with_points(cloud, more):
    """Return the cloud with other points among its own, measured at times of their own."""
    rng = np.random.default_rng(0)
    like = rng.integers(len(cloud.points_w), size=len(more))
    return replace(
        cloud,
        points_w=np.concatenate([cloud.points_w, more]),
        origins_w=np.concatenate([cloud.origins_w, cloud.origins_w[like]]),
        time_s=np.concatenate([cloud.time_s, cloud.time_s[like]]),
    )


def is_right(answer, angle_deg=1.0):
    assert not isinstance(answer.rotor, Refusal), answer.rotor
    rotor = answer.rotor
    error = stop_angle_difference_deg(rotor.stop_angle_deg, TRUTH["stop_angle_deg"])
    assert abs(error) < angle_deg
    assert np.linalg.norm(rotor.hub_w - HUB) < 0.5
    assert rotor.normal_w @ NORMAL > np.cos(np.radians(1.0))
    return True


def test_an_ascent_tells_tower_side_hub_and_angle_by_itself():
    answer = estimate_cloud(ascent(), Question())
    assert is_right(answer)
    assert answer.found_by == "tower"
    assert answer.looks >= 1
    for blade in answer.rotor.blades:
        assert blade.pitch_deg == pytest.approx(80.0, abs=6.0)


def test_a_single_look_is_enough_where_the_tower_is_seen_behind():
    assert is_right(estimate_cloud(hover(), Question()))


def test_what_is_known_is_used():
    turbine = load_turbine("iea-3.4-130", 0.6)
    given = Question(turbine, hub_w=HUB + np.array([1.5, -1.0, 2.0]), normal_w=NORMAL)
    answer = estimate_cloud(ascent(), given)
    assert is_right(answer, 0.5)
    assert answer.found_by == "given"
    loose = estimate_cloud(ascent(), Question())
    assert answer.rotor.sigma_deg < loose.rotor.sigma_deg


def test_the_size_alone_may_be_known():
    assert is_right(estimate_cloud(hover(), Question(rotor_radius_m=39.0)))


def test_noise_and_broken_points_are_left_out():
    cloud = ascent()
    rng = np.random.default_rng(1)
    noisy = with_points(cloud, rng.uniform(-60, 60, (1500, 3)) + HUB)
    points = noisy.points_w.copy()
    points[::40] = np.nan
    points[7::90, 1] = np.inf
    points[3::90] = 0.0
    answer = estimate_cloud(replace(noisy, points_w=points), Question())
    assert is_right(answer)
    assert answer.dropped == len(points) - np.sum(
        np.isfinite(points).all(axis=1) & (points != 0).any(axis=1)
    )


def test_a_second_turbine_behind_is_not_the_one():
    cloud = ascent()
    behind = cloud.points_w + 110.0 * NORMAL * [1, 1, 0] + [6.0, 0.0, 8.0]
    assert is_right(estimate_cloud(with_points(cloud, behind), Question()))


def test_hills_are_no_rotor():
    cloud = ascent()
    rng = np.random.default_rng(2)
    around = rng.uniform(-120, 120, (6000, 2))
    east, north = around.T
    ridge = 70.0 * np.exp(-(((north - 95.0) / 25.0) ** 2)) + 5.0 * np.sin(east / 13.0)
    hill = np.column_stack([around, ridge])[np.linalg.norm(around, axis=1) > 40.0]
    assert is_right(estimate_cloud(with_points(cloud, hill), Question()))


def test_the_paper_s_method_answers_too():
    answer = estimate_cloud(ascent(), Question(), FERMAT)
    assert not isinstance(answer.rotor, Refusal), answer.rotor
    error = stop_angle_difference_deg(answer.rotor.stop_angle_deg, TRUTH["stop_angle_deg"])
    assert abs(error) < 4.0
    assert answer.rotor.method == "fermat"


@pytest.mark.parametrize("settings", [Settings(), FERMAT])
def test_from_behind_no_angle_is_given(settings):
    cloud = hover()
    # What stands behind the rotor would be behind the viewer, were it seen from there.
    rotor_only = cloud.points_w[(cloud.points_w - HUB) @ NORMAL < 1.0]
    mirrored = RecordedCloud(rotor_only, HUB + 20.0 * NORMAL)
    known = estimate_cloud(mirrored, Question(hub_w=HUB), settings)
    assert isinstance(known.rotor, Refusal)
    if settings is FERMAT:
        told = estimate_cloud(mirrored, Question(hub_w=HUB, normal_w=NORMAL), settings)
        assert isinstance(told.rotor, Refusal)
        assert told.rotor.code is RefusalCode.SIDE_UNKNOWN


def climbed(turbine, behind=False):
    """Return a cloud of looks from the ground to the hub, 25 m before (or behind) the tower."""
    away = -turbine.normal_w * [1, 1, 0] if not behind else turbine.normal_w * [1, 1, 0]
    aside = np.array([-away[1], away[0], 0.0])
    clouds, origins, times = [], [], []
    for k, height in enumerate(np.linspace(0.25, 1.0, 9) * turbine.hub_w[2]):
        eye = 25.0 * away + 2.0 * aside + [0, 0, height]
        points, _ = turbine.scan(eye, seconds=1.0, seed=k)
        clouds.append(points)
        origins.append(np.broadcast_to(eye, points.shape))
        times.append(np.full(len(points), 5.0 * k))
    return RecordedCloud(np.concatenate(clouds), np.concatenate(origins), np.concatenate(times))


def test_a_small_rotor_of_unknown_size_is_found(synthetic_turbine):
    turbine = synthetic_turbine("v27", scale=1.0, stop_angle_deg=50.0)
    answer = estimate_cloud(climbed(turbine), Question())
    assert not isinstance(answer.rotor, Refusal), answer.rotor
    assert abs(stop_angle_difference_deg(answer.rotor.stop_angle_deg, 50.0)) < 1.5
    assert not answer.from_behind


def test_from_behind_the_ascent_tells_the_side_and_sigma_says_that_it_is_coarse(synthetic_turbine):
    turbine = synthetic_turbine(stop_angle_deg=50.0)
    answer = estimate_cloud(climbed(turbine, behind=True), Question())
    assert not isinstance(answer.rotor, Refusal), answer.rotor
    assert abs(stop_angle_difference_deg(answer.rotor.stop_angle_deg, 50.0)) < 5.0
    assert answer.rotor.normal_w @ turbine.normal_w > 0.98
    assert answer.from_behind
    assert answer.rotor.sigma_deg >= 2.5


@pytest.mark.parametrize("seed", [70016, 70032])
@pytest.mark.parametrize("hub_known", [False, True])
def test_a_blade_that_passes_for_a_short_tower_does_not_name_the_side(seed, hub_known):
    """Looks of drawn turbines in which it once did, and the angle was one from behind."""
    scene = make_scene(seed)
    hub_w = scene.prior_hub_w if hub_known else None
    answer = estimate_cloud(
        RecordedCloud(scene.points_w, scene.viewpoint_w),
        Question(rotor_radius_m=scene.radius_m, hub_w=hub_w),
    )
    assert not isinstance(answer.rotor, Refusal), answer.rotor
    error = stop_angle_difference_deg(answer.rotor.stop_angle_deg, scene.stop_angle_deg)
    assert abs(error) < 1.5
    assert answer.rotor.normal_w @ scene.normal_w > 0.99


def test_a_national_grid_is_a_frame_like_any_other():
    cloud, far = ascent(), np.array([512_000.0, 5_934_000.0, 412.0])
    moved = replace(cloud, points_w=cloud.points_w + far, origins_w=cloud.origins_w + far)
    answer = estimate_cloud(moved, Question())
    assert np.linalg.norm(answer.rotor.hub_w - HUB - far) < 0.5


@pytest.mark.parametrize(
    ("turn", "told"),
    [
        (np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]), "y axis seems to point up"),
        (lidar_in_body(23.0).T, "sensor's own frame"),
    ],
)
def test_a_cloud_that_is_not_upright_is_refused_with_what_it_seems_to_be(turn, told):
    cloud = hover()
    heading = np.arctan2(NORMAL[1], NORMAL[0])
    level = np.array(
        [
            [np.cos(heading), np.sin(heading), 0],
            [-np.sin(heading), np.cos(heading), 0],
            [0, 0, 1.0],
        ]
    )
    turned = (cloud.points_w - EYE) @ level.T @ turn.T
    answer = estimate_cloud(RecordedCloud(turned, np.zeros(3)), Question())
    assert isinstance(answer.rotor, Refusal)
    assert told in answer.rotor.text


def test_a_cloud_without_a_rotor_says_what_it_misses():
    cloud = hover()
    below = cloud.points_w[cloud.points_w[:, 2] < HUB[2] - 5.0]
    answer = estimate_cloud(RecordedCloud(below, EYE), Question())
    assert isinstance(answer.rotor, Refusal)
    assert "prior hub" in answer.rotor.text


def test_looks_that_differ_are_no_answer():
    """A rotor that turns by some degrees between two looks of a recording."""
    cloud = ascent()
    late = cloud.time_s > 18.0
    points, origins = cloud.points_w[late], cloud.origins_w[late]
    turn = np.radians(25.0)
    x, y, z = NORMAL
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    about = np.eye(3) + np.sin(turn) * cross + (1 - np.cos(turn)) * cross @ cross
    rel = points - HUB
    blade = np.abs(rel @ NORMAL) < 2.0
    turned = np.where(blade[:, None], HUB + rel @ about.T, points)
    time_s = cloud.time_s[late]
    both = RecordedCloud(
        np.concatenate([points, turned]),
        np.concatenate([origins, origins]),
        np.concatenate([time_s, time_s + 10.0]),
    )
    answer = estimate_cloud(both, Question(hub_w=HUB, normal_w=NORMAL))
    assert isinstance(answer.rotor, Refusal)
    assert answer.rotor.code is RefusalCode.NOT_CONVERGED


@pytest.mark.parametrize(
    ("points", "eye", "told"),
    [
        (np.zeros((0, 3)), EYE, "no points"),
        (np.full((500, 3), np.nan), EYE, "0 finite points of 500"),
        (1000.0 * hover().points_w, 1000.0 * EYE, "divide them by 1000"),
        (0.001 * hover().points_w, 0.001 * EYE, "must be metres"),
        (hover().points_w, EYE + 50_000.0, "viewpoint"),
    ],
)
def test_what_cannot_be_a_rotor_in_metres_is_said_before_any_fit(points, eye, told):
    with pytest.raises(UnusableCloud, match=told):
        estimate_cloud(RecordedCloud(points, eye), Question())


def test_coordinates_that_lost_their_digits_are_told():
    with pytest.raises(UnusableCloud, match=r"step by 0\.50 m"):
        estimate_cloud(replace(hover(), step_m=0.5), Question())
