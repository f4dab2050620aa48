"""What flight is told of the blade beside it."""

from dataclasses import replace

import numpy as np
import pytest

from mission.flight.command import SensingMode, SensingTask
from mission.processes.blade_follower import BladeFollower

TASK = SensingTask(
    SensingMode.BLADE, 1, blade="A", side="PS", blade_root_w=(0.0, 0.0, 0.0),
    blade_tip_w=(40.0, 0.0, 0.0),
)  # fmt: skip
HERE = np.array([20.0, -12.0, 0.0])


@pytest.fixture
def skin():
    """(N, 3) points of a blade 0.4 m above its model."""
    draw = np.random.default_rng(5)
    count = 600
    along, round_rad = draw.uniform(10.0, 30.0, count), draw.uniform(np.pi, 2 * np.pi, count)
    return np.stack([along, 0.5 * np.sin(round_rad), 0.4 + 0.5 * np.cos(round_rad)], axis=1)


def test_the_blade_is_told_where_it_hangs(skin):
    track = BladeFollower({}).follow(TASK, skin, 1.0, HERE)
    assert track.blade == "A"
    assert track.offset_w[2] == pytest.approx(0.4, abs=0.1)
    assert track.distance_m == pytest.approx(12.0, abs=0.6)


def test_of_a_side_that_the_lidar_cannot_look_at_nothing_is_told(skin):
    assert BladeFollower({}).follow(replace(TASK, blind=True), skin, 1.0, HERE) is None


def test_points_of_the_nacelle_are_not_the_blades(skin):
    around = ((15.0, 0.0, 0.0), (35.0, 0.0, 0.0), 3.0, 3.0)
    near = skin[(skin[:, 0] > 16.0) & (skin[:, 0] < 34.0)]
    assert BladeFollower({}).follow(TASK, near, 1.0, HERE) is not None
    assert BladeFollower({}).follow(replace(TASK, others=(around,)), near, 1.0, HERE) is None
