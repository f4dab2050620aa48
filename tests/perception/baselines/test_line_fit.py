"""Angle by straight lines in a cloud: right where it should be, refused where it must be."""

import math

import numpy as np
import pytest

from perception.baselines.line_fit import (
    LineFitSettings,
    Variant,
    fit_rotor_by_lines,
    three_lines,
    two_lines,
)
from perception.baselines.ransac_line import fit_line
from perception.geometry import stop_angle_difference_deg
from perception.rotor import Refusal, RefusalCode, Rotor, direction_at
from perception.values import Float

HUB_W = np.array([3.0, 25.0, 80.0])
NORMAL_W = np.array([0.0, 1.0, 0.0])
DOWN_W = np.array([0.0, 0.0, -1.0])


def cloud(angle_deg: float, blades: int = 3, tower: bool = True) -> Float:
    rng = np.random.default_rng(int(angle_deg) + blades)
    parts = []
    for k in range(blades):
        along = direction_at(math.radians(angle_deg + 120 * k), NORMAL_W, DOWN_W)
        across = np.cross(NORMAL_W, along)
        r = rng.uniform(1.0, 18.0, 700)[:, None]
        chord = (2.4 - 0.07 * r) * rng.uniform(-0.5, 0.5, (700, 1))
        parts.append(HUB_W + r * along + chord * across)
    if tower:
        z = rng.uniform(40.0, 77.0, 600)
        turn = rng.uniform(0, np.pi, 600)
        ring = np.stack([np.cos(turn), 5.0 - np.sin(turn), np.zeros(600)], axis=1)
        parts.append(np.array([HUB_W[0], HUB_W[1], 0.0]) + ring + z[:, None] * [0, 0, 1.0])
    points = np.concatenate(parts)
    return np.asarray(points + rng.normal(0, 0.02, points.shape), np.float64)


def estimate(points: Float, variant: Variant) -> Rotor | Refusal:
    prior = HUB_W + np.array([0.6, -0.3, 0.5])
    return fit_rotor_by_lines(points, np.array([3.0, 0.0, 80.0]), prior, variant=variant)


@pytest.mark.parametrize("variant", list(Variant))
@pytest.mark.parametrize("angle_deg", [35.0, 50.0, 60.0, 70.0, 85.0])
def test_the_angle_and_the_hub_are_found_near_the_symmetric_pose(
    variant: Variant, angle_deg: float
) -> None:
    rotor = estimate(cloud(angle_deg), variant)
    assert isinstance(rotor, Rotor)
    assert abs(stop_angle_difference_deg(rotor.stop_angle_deg, angle_deg)) < 2.0
    assert float(np.linalg.norm(rotor.hub_w - HUB_W)) < 0.8
    assert rotor.normal_w @ NORMAL_W > 0.999
    assert rotor.method == variant.value
    assert all(blade.pitch_deg is None for blade in rotor.blades)


@pytest.mark.parametrize("angle_deg", [0.0, 10.0, 30.0, 90.0, 110.0, 119.5])
def test_three_lines_hold_at_every_angle(angle_deg: float) -> None:
    rotor = estimate(cloud(angle_deg), Variant.THREE_LINES)
    assert isinstance(rotor, Rotor)
    assert abs(stop_angle_difference_deg(rotor.stop_angle_deg, angle_deg)) < 2.0


def test_too_few_points_are_refused() -> None:
    refusal = estimate(cloud(60.0)[:40], Variant.TWO_LINES)
    assert isinstance(refusal, Refusal)
    assert refusal.code is RefusalCode.NO_POINTS


def test_points_that_are_not_numbers_are_left_out() -> None:
    points = cloud(60.0)
    points[::7] = np.nan
    assert isinstance(estimate(points, Variant.TWO_LINES), Rotor)


def test_a_ball_of_points_holds_no_plane() -> None:
    ball = HUB_W + np.random.default_rng(1).normal(0, 8.0, (400, 3)) * [1, 0.8, 1]
    refusal = fit_rotor_by_lines(
        ball, np.array([3.0, -10.0, 80.0]), HUB_W, settings=LineFitSettings(min_inliers=200)
    )
    assert isinstance(refusal, Refusal)


def test_a_side_without_points_is_refused() -> None:
    flat = np.stack([np.linspace(4, 18, 200), np.linspace(2, 9, 200)], axis=1)
    refusal = two_lines(flat, LineFitSettings())
    assert isinstance(refusal, Refusal)
    assert refusal.code is RefusalCode.LOW_VISIBILITY


def test_sides_that_contradict_each_other_are_refused() -> None:
    t = np.linspace(4, 18, 200)
    right = np.stack([t, 0.5 * t], axis=1)
    left = np.stack([-t, 0.0 * t], axis=1)
    refusal = two_lines(np.concatenate([right, left]), LineFitSettings())
    assert isinstance(refusal, Refusal)
    assert refusal.code is RefusalCode.NOT_A_ROTOR


def test_two_blades_are_not_three() -> None:
    refusal = estimate(cloud(60.0, blades=2, tower=False), Variant.THREE_LINES)
    assert isinstance(refusal, Refusal)
    assert refusal.code is RefusalCode.TWO_BLADES


def test_parallel_lines_meet_nowhere() -> None:
    t = np.linspace(-18, 18, 300)
    flat = np.concatenate([np.stack([t, np.full_like(t, y)], axis=1) for y in (-8.0, 0.0, 8.0)])
    refusal = three_lines(flat, LineFitSettings())
    assert isinstance(refusal, Refusal)
    assert refusal.code is RefusalCode.NOT_A_ROTOR


def test_a_line_is_found_among_scattered_points() -> None:
    rng = np.random.default_rng(3)
    t = rng.uniform(-10, 10, 200)
    on_line = np.stack([t, 2.0 + 0.5 * t], axis=1) + rng.normal(0, 0.05, (200, 2))
    points = np.concatenate([on_line, rng.uniform(-12, 12, (150, 2))])
    line = fit_line(points, threshold=0.3, min_inliers=60, min_length=5.0)
    assert line is not None
    assert abs(line.direction[1] / line.direction[0] - 0.5) < 0.02
    assert fit_line(points[200:], threshold=0.01, min_inliers=60, min_length=5.0) is None
    assert fit_line(points[:10], threshold=0.3, min_inliers=60, min_length=5.0) is None
