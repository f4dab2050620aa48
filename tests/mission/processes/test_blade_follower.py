"""What flight is told of the blade beside it."""

from dataclasses import replace

import numpy as np
import pytest

from config.presets import load_turbine
from mission.flight.command import SensingMode, SensingTask
from mission.flight.observation import BladeEstimate
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


def chord_and_axis(turbine, metres):
    """Return a type's chord (m) and where along it the pitch axis lies, at metres of the blade."""
    shape = turbine.blade
    columns = (shape.chord_m, shape.pitch_axis)
    return [np.interp(metres / turbine.blade_length_m, shape.span, column) for column in columns]


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


def test_the_tower_is_left_out_where_it_appears_by_now(skin):
    follower = BladeFollower({})
    # A tower beside the blade; the position has drifted, and both appear 2.5 m farther up.
    drift_w = np.array([0.0, 0.0, 2.5])
    draw = np.random.default_rng(6)
    tower = np.stack(
        [draw.uniform(12.0, 28.0, 900), np.full(900, 2.0), draw.uniform(1.6, 3.9, 900)], axis=1
    )
    task = replace(
        TASK, others=(((0.0, 2.0, 2.75), (40.0, 2.0, 2.75), 1.2, 1.2),), half_width_m=6.5
    )
    seen = np.concatenate([skin, tower]) + drift_w
    unaware = follower.follow(task, seen, 1.0, HERE)
    follower._sight.appears_moved = lambda places_w, _stamp_s, _position_w: 0 * places_w + drift_w
    aware = follower.follow(task, seen, 1.1, HERE)
    assert aware.offset_w[2] == pytest.approx(2.9, abs=0.15)
    assert abs(unaware.offset_w[2] - 2.9) > 0.5


def test_a_blade_of_which_one_end_of_the_chord_is_out_of_view_is_laid_by_the_other():
    turbine = load_turbine("nrel-1.72-103")
    shape, draw = turbine.blade, np.random.default_rng(3)
    metres = draw.uniform(16.0, 28.0, 2500)
    chord, ahead = chord_and_axis(turbine, metres)
    hub, axis = np.array([0.0, 12.0, 80.0]), np.array([0.0, 0.0, 1.0])
    root = hub + turbine.hub_radius_m * axis
    twist = float(np.interp(22.0 / turbine.blade_length_m, shape.span, shape.twist_deg))
    # Square to the sight, hanging 0.2 m beside its model.
    along_chord = (ahead - draw.uniform(0.0, 1.0, 2500)) * chord
    skin = root + metres[:, None] * axis + (along_chord + 0.2)[:, None] * np.array([1.0, 0.0, 0.0])
    task = replace(
        TASK, turbine="t", side="PS", hub_w=tuple(hub), normal_w=(0.0, 1.0, 0.0),
        blade_root_w=tuple(root), blade_tip_w=tuple(root + turbine.blade_length_m * axis),
        half_width_m=4.0, blades=(BladeEstimate(TASK.blade, (0.0, 0.0, 1.0), -twist),),
    )  # fmt: skip
    place = np.array([0.0, 0.0, root[2] + 22.0])

    def aside_m(points):
        return BladeFollower({"t": turbine}).follow(task, points, 1.0, place).offset_w[0]

    whole_m = aside_m(skin)
    assert aside_m(skin[skin[:, 0] > -0.4]) == pytest.approx(whole_m, abs=0.12)
    assert aside_m(skin[skin[:, 0] < 0.1]) == pytest.approx(whole_m, abs=0.12)


def test_a_blade_seen_aslant_hangs_where_it_does_whichever_end_of_the_chord_is_nearer():
    turbine = load_turbine("nrel-1.72-103")
    shape, rng = turbine.blade, np.random.default_rng(2)
    metres = rng.uniform(16.0, 28.0, 2500)
    chord, ahead = chord_and_axis(turbine, metres)
    # Pitched by 45 deg: of the blade that is seen from the front, one end of the chord is nearer.
    along_chord = (ahead - rng.uniform(0.0, 1.0, 2500)) * chord
    lead = np.array([np.cos(np.pi / 4), -np.sin(np.pi / 4), 0.0])
    hub = np.array([0.0, 12.0, 80.0])
    axis = np.array([0.0, 0.0, 1.0])
    root = hub + turbine.hub_radius_m * axis
    skin = root + metres[:, None] * axis + along_chord[:, None] * lead
    half = np.interp(metres / turbine.blade_length_m, shape.span, shape.thickness) * chord / 2
    skin -= 0.7 * half[:, None] * np.array([np.sin(np.pi / 4), np.cos(np.pi / 4), 0.0])
    twist = float(np.interp(22.0 / turbine.blade_length_m, shape.span, shape.twist_deg))
    task = replace(
        TASK, turbine="t", side="PS", hub_w=tuple(hub), normal_w=(0.0, 1.0, 0.0),
        blade_root_w=tuple(root), blade_tip_w=tuple(root + turbine.blade_length_m * axis),
        half_width_m=4.0, others=(),
        blades=(BladeEstimate(TASK.blade, (0.0, 0.0, 1.0), 45.0 - twist),),
    )  # fmt: skip
    place = np.array([0.0, 0.0, root[2] + 22.0])
    track = BladeFollower({"t": turbine}).follow(task, skin, 1.0, place)
    unaware = BladeFollower({"t": turbine}).follow(replace(task, blades=()), skin, 1.0, place)
    assert abs(track.offset_w[1]) < 0.2
    assert abs(unaware.offset_w[1]) > 0.25
