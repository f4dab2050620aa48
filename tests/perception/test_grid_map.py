import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.grid_kernel import Tube
from perception.grid_map import GridMap
from perception.ring_search import search_points, search_rings


def grid(half_m=5.0):
    return GridMap(np.zeros(3), half_m=half_m, resolution_m=0.2)


@settings(deadline=None, max_examples=60)
@given(start=st.tuples(*[st.floats(-15, 15)] * 3), end=st.tuples(*[st.floats(-4.7, 4.7)] * 3))
def test_a_ray_frees_what_it_passes_and_fills_where_it_ends(start, end):
    start, end = np.array(start), np.array(end)
    one = grid()
    one.fuse(end[None], start)
    assert one.occupied(end)
    length = np.linalg.norm(end - start)
    shares = np.linspace(0, 1, 400)[:, None]
    on_ray = start + shares * (end - start)
    before = on_ray[(1 - shares[:, 0]) * length > 0.4]
    inside = before[(np.abs(before) < 5).all(axis=1)]
    assert not one.occupied(inside).any()
    # What the ray passed stays free after one stray return there.
    if len(inside) > 10:
        one.fuse(end[None], start)
        middle = inside[len(inside) // 2]
        cell = np.floor(middle / 0.2)
        centre = (cell + 0.5) * 0.2
        assert one.log_odds(centre) <= 0.0


def test_fog_that_later_rays_pass_through_vanishes():
    one = grid()
    fog = np.array([[0.1, 0.1, 0.1]])
    one.fuse(fog, np.array([-10.0, 0.1, 0.1]))
    assert one.occupied(fog[0])
    for _ in range(4):
        one.fuse(np.array([[4.1, 0.1, 0.1]]), np.array([-10.0, 0.1, 0.1]))
    assert not one.occupied(fog[0])
    assert one.occupied(np.array([4.1, 0.1, 0.1]))


def test_a_surface_seen_at_a_grazing_angle_does_not_carve_itself():
    one = grid()
    surface = np.stack([np.linspace(-4, 4, 200), np.full(200, 0.1), np.full(200, 0.1)], axis=1)
    one.fuse(surface, np.array([-20.0, 0.5, 0.1]))
    assert one.occupied(surface).all()


def test_points_outside_the_box_or_nowhere_do_no_harm():
    one = grid()
    bad = np.array([[np.nan, 0, 0], [np.inf, 0, 0], [90.0, 0, 0], [-90, 3, 3]])
    one.fuse(bad, np.array([0.0, 0, -20]))
    assert not one.occupied(np.array([90.0, 0, 0]))


def test_cells_are_named_once():
    one = grid()
    points = np.array([[0.05, 0.05, 0.05], [0.15, 0.1, 0.19], [0.25, 0.05, 0.05]])
    np.testing.assert_allclose(one.cell_centres(points), [[0.1, 0.1, 0.1], [0.3, 0.1, 0.1]])


def test_cells_that_rings_meet_are_the_same_where_only_their_tube_is_walked():
    rng = np.random.default_rng(4)
    axis = np.array([0.2, 0.97, -0.1]) / np.linalg.norm([0.2, 0.97, -0.1])
    drone = np.array([-3.0, -15.0, 2.0])
    whole, part = (GridMap(np.zeros(3), half_m=12.0, resolution_m=0.2) for _ in range(2))
    centres = search_points(-6.0 * axis, axis, 0.2, 60)
    tube = Tube(centres[0], axis, 12.0, 5.0, 0.4)
    part.fuse(rng.uniform(-5, 5, (50, 3)), drone)  # of a map that is begun anew
    part.restart(np.zeros(3))
    for _ in range(3):
        cloud = rng.normal(0, 1, (4000, 3)) * (6.0, 3.0, 6.0)
        whole.fuse(cloud, drone)
        part.fuse(cloud, drone, tube)
    _, expected = search_rings(whole, centres, axis, 5.0, 0.1)
    _, found = search_rings(part, centres, axis, 5.0, 0.1)
    assert expected.sum() > 50
    np.testing.assert_array_equal(found, expected)


def test_a_map_begun_anew_knows_nothing():
    one = grid()
    one.fuse(np.array([[0.1, 0.1, 0.1]]), np.array([-10.0, 0.1, 0.1]))
    one.restart(np.zeros(3))
    assert not one.occupied(np.array([0.1, 0.1, 0.1]))


@pytest.mark.parametrize("seed", range(4))
def test_rings_meet_the_cells_that_a_look_at_each_of_their_places_finds(seed):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    one = GridMap(np.zeros(3), half_m=8.0, resolution_m=0.2)
    for _ in range(2):
        one.fuse(rng.normal(0, 3.0, (6000, 3)), -14.0 * axis)
    centres = search_points(-5.0 * axis, axis, 0.17, 50)
    ring, found = search_rings(one, centres, axis, 4.0, 0.13)
    assert found.sum() > 200
    np.testing.assert_array_equal(found, one.occupied(centres[:, None, :] + ring))


def test_returns_of_one_cell_carve_as_often_as_there_are_returns():
    one, other = grid(), grid()
    start, end = np.array([-4.0, 0.1, 0.1]), np.array([4.1, 0.1, 0.1])
    one.fuse(np.repeat(end[None], 3, axis=0), start)
    for _ in range(3):
        other.fuse(end[None], start)
    middle = np.array([0.1, 0.1, 0.1])
    assert one.log_odds(middle) == other.log_odds(middle) < -1.0
