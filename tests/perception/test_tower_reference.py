"""The tower's axis as reference, whole, half hidden, and where there is none to be believed."""

import math

import numpy as np
import pytest

from perception.rotor import angle_of
from perception.tower_reference import tower_reference, without_tower

NORMAL = np.array([0.0, 1.0, 0.0])
DOWN = np.array([0.0, 0.0, -1.0])
RADIUS_M = 50.0


def _tower(lean_deg: float, sides_deg: tuple[float, float], count: int = 900, seed: int = 0):
    """Return points of a leaning cone 4 m behind the hub, seen from the front over some sides."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(4.5, 16.0, count)
    turn = np.radians(rng.uniform(*sides_deg, count))
    radius = 1.4 + 0.012 * depth
    x = radius * np.sin(turn) + math.tan(math.radians(lean_deg)) * depth
    y = 4.0 - radius * np.cos(turn)
    return np.stack([x, y, -depth], axis=1) + rng.normal(0, 0.015, (count, 3))


def _off_deg(points, lean_deg: float) -> float:
    found = tower_reference(points, np.zeros(3), NORMAL, DOWN, RADIUS_M)
    assert found is not None
    lean = math.radians(lean_deg)
    true = np.array([math.sin(lean), 0.0, -math.cos(lean)])
    return abs(math.degrees(angle_of(found.down_w, NORMAL, true)))


@pytest.mark.parametrize("lean_deg", [-1.2, 0.0, 0.8])
def test_a_tower_in_full_view_tells_its_lean(lean_deg):
    assert _off_deg(_tower(lean_deg, (-75, 75)), lean_deg) < 0.1


@pytest.mark.parametrize("sides_deg", [(20, 75), (-75, -20)])
def test_a_tower_half_hidden_by_a_blade_is_held_by_the_shaft(sides_deg):
    assert _off_deg(_tower(0.6, sides_deg, 250), 0.6) < 0.45


def test_a_pole_that_stands_far_from_plumb_is_not_the_tower():
    found = tower_reference(_tower(7.0, (-75, 75)), np.zeros(3), NORMAL, DOWN, RADIUS_M)
    assert found is None


def test_a_short_piece_is_not_believed():
    piece = _tower(0.0, (-75, 75))
    piece = piece[piece[:, 2] > -6.0]
    assert tower_reference(piece, np.zeros(3), NORMAL, DOWN, RADIUS_M) is None


def test_what_hangs_before_the_tower_is_told_from_it():
    rng = np.random.default_rng(2)
    tower = _tower(0.4, (-75, 75))
    blade = rng.uniform((-0.4, -0.8, -30.0), (0.4, 1.6, -3.0), (500, 3))
    both = np.concatenate([tower, blade])
    found = tower_reference(both, np.zeros(3), NORMAL, DOWN, RADIUS_M)
    assert found is not None
    kept = without_tower(both, np.zeros(3), found)
    assert len(kept) == pytest.approx(len(blade), abs=10)
    assert kept[:, 1].max() < 1.65
