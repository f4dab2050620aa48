import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.grid_map import GridMap
from perception.ring_search import ring_offsets, search_points, search_rings

DIRECTION = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
    lambda v: np.linalg.norm(v) > 0.1
)


@given(normal=DIRECTION, radius=st.floats(2, 12), step=st.floats(0.05, 0.5))
def test_the_ring_obeys_equation_2(normal, radius, step):
    normal = np.array(normal) / np.linalg.norm(normal)
    ring = ring_offsets(normal, radius, step)
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), radius)
    np.testing.assert_allclose(ring @ normal, 0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(np.diff(ring, axis=0), axis=1), step)
    assert np.linalg.norm(ring[-1] - ring[0]) <= step + 1e-9


def test_search_points_obey_equation_1():
    points = search_points(np.array([1.0, 2, 3]), np.array([0.0, 1, 0]), 0.2, 5)
    assert points[:, 1] == pytest.approx([2.2, 2.4, 2.6, 2.8, 3.0])


def test_an_occupied_cell_on_the_ring_is_found():
    grid = GridMap(np.zeros(3), half_m=10.0, resolution_m=0.2)
    grid.fuse(np.array([[8.0, 0.1, 0.1]]), np.array([8.0, -20, 0]))
    centres = search_points(np.array([0, -3.0, 0]), np.array([0, 1.0, 0]), 0.2, 30)
    ring, occupied = search_rings(grid, centres, np.array([0, 1.0, 0]), 8.0, 0.1)
    assert occupied.any()
    points = centres[:, None, :] + ring
    np.testing.assert_allclose(points[occupied], [[8.0, 0.1, 0.1]] * occupied.sum(), atol=0.3)
