import time

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from perception.blade_line import fit_blade_line, outside_cone
from perception.section_depth import SectionDepth

ROOT = np.array([2.0, 5.0, 60.0])


def blade(direction, view, *, length=40.0, chord=2.0, thickness=0.5, shift=(0.0, 0.0), count=3000,
          seed=0, noise=0.02):  # fmt: skip
    """Points of an elliptic blade's near half, the axis shifted (aside, deep) from the model."""
    rng = np.random.default_rng(seed)
    along = rng.uniform(0, length, count)
    angle = rng.uniform(-np.pi / 2, np.pi / 2, count)
    side = np.cross(direction, view)
    aside = 0.5 * chord * np.sin(angle) + shift[0]
    deep = -0.5 * thickness * np.cos(angle) + shift[1]
    points = ROOT + along[:, None] * direction + aside[:, None] * side + deep[:, None] * view
    return points + rng.normal(0, noise, points.shape)


def frame(polar, azimuth):
    direction = np.array(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    )
    view = np.cross(direction, [0.3, 0.9, -0.2])
    return direction, view / np.linalg.norm(view)


def fit(points, vehicle, direction, *, length=40.0, half_thickness=0.25):
    return fit_blade_line(
        points, vehicle, ROOT, ROOT + length * direction, 2.0, half_thickness_m=half_thickness
    )


@settings(deadline=None, max_examples=40)
@given(
    polar=st.floats(0.1, 3.0),
    azimuth=st.floats(-3.1, 3.1),
    station=st.floats(3, 37),
    reach=st.floats(8, 20),
    aside=st.floats(-0.6, 0.6),
    deep=st.floats(-0.6, 0.6),
)
def test_the_foot_is_the_perpendicular_of_the_true_axis(
    polar, azimuth, station, reach, aside, deep
):
    direction, view = frame(polar, azimuth)
    assume(np.linalg.norm(np.cross(direction, [0.3, 0.9, -0.2])) > 0.2)
    vehicle = ROOT + station * direction - reach * view
    line = fit(blade(direction, view, shift=(aside, deep)), vehicle, direction)
    side = np.cross(direction, view)
    foot = ROOT + station * direction + aside * side + deep * view
    assert line is not None
    assert np.linalg.norm(line.foot_w - foot) < 0.35
    assert (vehicle - line.foot_w) @ line.direction_w == pytest.approx(0, abs=1e-6)  # Eq. 3
    np.testing.assert_allclose(line.offset_w, aside * side + deep * view, atol=0.2)
    assert line.metre_m == pytest.approx(station, abs=0.3)
    assert line.angle_rad < 0.05


def test_the_near_skin_is_nearer_than_the_axis():
    direction, view = frame(1.2, 0.3)
    vehicle = ROOT + 20 * direction - 12 * view
    line = fit(blade(direction, view, thickness=1.0), vehicle, direction, half_thickness=0.5)
    assert line.distance_m == pytest.approx(12.0, abs=0.25)
    assert 0.3 < line.distance_m - line.surface_distance_m < 0.7


def test_outliers_of_tower_and_neighbour_do_not_move_the_line():
    direction, view = frame(1.2, 0.3)
    vehicle = ROOT + 20 * direction - 12 * view
    rng = np.random.default_rng(1)
    near = ROOT + rng.uniform(14, 26, (60, 1)) * direction + rng.uniform(-1.9, 1.9, (60, 3))
    far = rng.normal(0, 20, (5000, 3)) + ROOT + 25 * view
    line = fit(np.concatenate([blade(direction, view), near, far]), vehicle, direction)
    assert np.linalg.norm(line.foot_w - (ROOT + 20 * direction)) < 0.3


def test_a_tip_in_view_is_measured_and_one_out_of_view_is_not_claimed():
    direction, view = frame(1.2, 0.3)
    points = blade(direction, view, length=39.0)
    at_tip = fit(points, ROOT + 37 * direction - 12 * view, direction)
    assert at_tip.tip_m == pytest.approx(39.0, abs=0.4)
    assert fit(points, ROOT + 20 * direction - 12 * view, direction).tip_m is None


def test_an_edge_with_few_returns_still_holds_the_distance():
    direction, view = frame(1.2, 0.3)
    points = blade(direction, view, chord=0.05, thickness=0.01, count=120)
    line = fit(points, ROOT + 20 * direction - 12 * view, direction, half_thickness=0.0)
    assert line.distance_m == pytest.approx(12.0, abs=0.15)


def test_beyond_the_tip_or_without_points_there_is_no_line():
    direction, view = frame(1.2, 0.3)
    vehicle = ROOT + 20 * direction - 12 * view
    assert fit(np.empty((0, 3)), vehicle, direction) is None
    assert fit(np.full((50, 3), np.nan), vehicle, direction) is None
    assert fit(blade(direction, view, length=5.0), vehicle, direction) is None
    assert fit(blade(direction, view), ROOT + 20 * direction, direction) is None


def test_twenty_thousand_points_are_fitted_fast():
    direction, view = frame(1.2, 0.3)
    points = blade(direction, view, count=20_000)
    vehicle = ROOT + 20 * direction - 12 * view
    fit(points, vehicle, direction)
    start = time.perf_counter()
    for _ in range(5):
        fit(points, vehicle, direction)
    assert (time.perf_counter() - start) / 5 < 0.03


def test_points_of_a_tower_beside_the_blade_are_left_out():
    rng = np.random.default_rng(1)
    top, foot = np.array([4.0, 0.0, 80.0]), np.array([4.0, 0.0, 0.0])
    height = rng.uniform(0, 80, 4000)
    radius = 1.2 + (2.0 - 1.2) * (80 - height) / 80 + rng.normal(0, 0.03, 4000)
    angle = rng.uniform(-np.pi, np.pi, 4000)
    tower = np.stack([4 + radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    hanging = np.stack([rng.uniform(-0.4, 0.4, 500), rng.uniform(-1, 1, 500),
                        rng.uniform(40, 78, 500)], axis=1)  # fmt: skip
    left = outside_cone(np.concatenate([tower, hanging]), top, foot, (1.2 + 0.5, 2.0 + 0.5))
    assert np.array_equal(left, hanging)


def test_an_edge_is_measured_at_its_nearest_skin_and_by_each_points_own_section():
    """Seen edge-on, flanks go on behind the edge, and the chord tapers along the blade."""
    rng = np.random.default_rng(5)
    direction, view = frame(1.2, 0.3)
    side, count = np.cross(direction, view), 2500
    along = rng.uniform(8.0, 32.0, count)
    ahead = np.interp(along, [8.0, 32.0], [2.4, 0.8])
    behind = 0.5 * rng.random(count) ** 2
    points = ROOT + along[:, None] * direction + (behind - ahead)[:, None] * view
    points += 0.1 * rng.standard_normal((count, 1)) * side + rng.normal(0, 0.02, points.shape)
    vehicle = ROOT + 20 * direction - 12 * view
    metre = np.array([0.0, 8.0, 32.0, 40.0])
    depth = SectionDepth(metre, np.array([2.4, 2.4, 0.8, 0.8]), edge=True)
    line = fit_blade_line(points, vehicle, ROOT, ROOT + 40 * direction, 3.0, depth=depth)
    assert line is not None
    assert line.distance_m == pytest.approx(12.0, abs=0.06)
    assert line.angle_rad < 0.01


def sections(side, view, *, chord=2.0, taper=0.0, bend=0.0, length=40.0):
    """A model whose chord lies square to the view, 40 % of it before the axis."""
    metre = np.linspace(0, length, 41)
    chords = chord * (1 - taper * metre / length)
    return SectionDepth(
        metre, np.full(41, 0.25), edge=False,
        leading_w=0.4 * chords[:, None] * side, trailing_w=-0.6 * chords[:, None] * side,
        bend_w=bend * (metre[:, None] / length) ** 2 * side,
    )  # fmt: skip


def near_skin(direction, view, along, share, model, shift):
    """Points (N, 3) of the skin at metres and shares of the chord, the blade moved aside."""
    side = np.cross(direction, view)
    lead, trail, bend = (
        np.interp(along, model.metre_m, column @ side)
        for column in (model.leading_w, model.trailing_w, model.bend_w)
    )
    aside = trail + share * (lead - trail) + bend + shift
    return ROOT + along[:, None] * direction + aside[:, None] * side - 0.25 * view


@pytest.mark.parametrize("shift", [-0.5, 0.0, 0.4])
def test_a_field_of_view_that_cuts_the_blade_aslant_does_not_lean_its_line(shift):
    direction, view = frame(1.2, 0.3)
    side, rng = np.cross(direction, view), np.random.default_rng(4)
    model = sections(side, view)
    along, share = rng.uniform(21, 26, 900), rng.uniform(0, 1, 900)
    points = near_skin(direction, view, along, share, model, shift)
    # The farther from the foot, the more of the trailing half is in view.
    seen = share < 0.25 + 0.1 * (along - 21)
    vehicle = ROOT + 20 * direction - 12 * view
    line = fit_blade_line(points[seen], vehicle, ROOT, ROOT + 40 * direction, 3.0, depth=model)
    # The middle of the chord, which lies a tenth of it behind the axis.
    assert line.offset_w @ side == pytest.approx(shift - 0.2, abs=0.15)
    assert line.direction_w @ side == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("bend", [0.0, 2.0])
def test_a_tapering_bent_blade_seen_ahead_is_laid_by_its_own_sections_there(bend):
    direction, view = frame(1.2, 0.3)
    side, rng = np.cross(direction, view), np.random.default_rng(5)
    model = sections(side, view, chord=4.0, taper=0.8, bend=bend)
    along, share = rng.uniform(23, 26, 600), rng.uniform(0, 1, 600)
    points = near_skin(direction, view, along, share, model, 0.3)
    vehicle = ROOT + 20 * direction - 12 * view
    line = fit_blade_line(points, vehicle, ROOT, ROOT + 40 * direction, 3.0, depth=model)
    chord = 4.0 * (1 - 0.8 / 2)
    middle = -0.1 * chord + 0.25 * bend  # at the foot, by the model
    assert line.offset_w @ side == pytest.approx(middle + 0.3, abs=0.1)
