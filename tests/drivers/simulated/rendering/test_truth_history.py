from __future__ import annotations

import numpy as np
import pytest

from drivers.simulated.link import TruthState
from drivers.simulated.truth_history import TruthHistory, rotate
from perception.geometry import quaternion_from_rotation, rotation_from_euler


def state(t_s: float, yaw_rad: float = 0.0) -> TruthState:
    w, x, y, z = quaternion_from_rotation(rotation_from_euler(0.1, 0.0, yaw_rad))
    q = (float(w), float(x), float(y), float(z))
    return TruthState(t_s, (t_s, 0.0, 2 * t_s), (1, 0, 2), q, (0, 0, 0), q, 0.0)


def test_poses_are_interpolated_between_states_and_held_beyond() -> None:
    history = TruthHistory()
    for k in range(5):
        history.add(state(0.02 * k, 0.1 * k))
    positions, quaternions = history.body(np.array([0.03, 0.5]))
    assert positions[0] == pytest.approx([0.03, 0.0, 0.06])
    assert positions[1] == pytest.approx([0.08, 0.0, 0.16])
    expected = quaternion_from_rotation(rotation_from_euler(0.1, 0.0, 0.15))
    assert quaternions[0] == pytest.approx(expected, abs=1e-4)
    assert history.camera(0.03) == pytest.approx(expected, abs=1e-4)


def test_one_state_is_enough_and_older_ones_are_left_out() -> None:
    history = TruthHistory()
    history.add(state(1.0))
    history.add(state(0.5))
    assert history.newest_s == history.oldest_s == 1.0
    assert history.body(np.array([0.0, 9.0]))[0][:, 0] == pytest.approx([1.0, 1.0])


def test_it_keeps_only_the_last_seconds() -> None:
    history = TruthHistory()
    for k in range(5000):
        history.add(state(0.02 * k))
    assert history.newest_s - history.oldest_s < 25.0
    assert len(history.between(history.newest_s - 0.1, history.newest_s)) in (5, 6)


def test_rotate_agrees_with_the_rotation_matrix() -> None:
    rotation = rotation_from_euler(0.3, -0.4, 2.0)
    q = np.tile(quaternion_from_rotation(rotation).astype(np.float32), (4, 1))
    vectors = np.random.default_rng(1).normal(size=(4, 3)).astype(np.float32)
    np.testing.assert_allclose(rotate(q, vectors), vectors @ rotation.T, atol=1e-5)
