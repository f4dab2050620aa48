import numpy as np
import pytest
from sklearn.cluster import DBSCAN

from perception.bri_clustering import cluster_bri, dbscan


def patch(centre, seed=0):
    return np.asarray(centre) + np.random.default_rng(seed).uniform(-0.8, 0.8, (12, 3))


def test_three_blades_give_three_centres():
    centres = np.array([[0, 0, -8.0], [7, 0, 4], [-7, 0, 4]])
    cells = np.concatenate([patch(c, k) for k, c in enumerate(centres)])
    found = cluster_bri(cells, eps_m=2.5, min_samples=1)
    assert found.shape == (3, 3)
    for centre in centres:
        assert np.linalg.norm(found - centre, axis=1).min() < 0.6


def test_two_blades_are_two_and_nothing_is_nothing():
    cells = np.concatenate([patch((0, 0, -8)), patch((7, 0, 4))])
    assert len(cluster_bri(cells, eps_m=2.5, min_samples=1)) == 2
    assert cluster_bri(np.empty((0, 3)), eps_m=2.5, min_samples=1).shape == (0, 3)


def test_lone_cells_are_noise_when_more_are_asked_for():
    cells = np.concatenate([patch((0, 0, -8)), [[30.0, 0, 0]]])
    assert len(cluster_bri(cells, eps_m=2.5, min_samples=3)) == 1


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("least", [1, 3, 5])
def test_groups_are_those_of_the_library(seed, least):
    points = np.random.default_rng(seed).uniform(-5, 5, (60, 3))
    expected = DBSCAN(eps=1.8, min_samples=least).fit_predict(points)
    found = dbscan(points, 1.8, least)
    core = np.array([(np.linalg.norm(points - p, axis=1) <= 1.8).sum() >= least for p in points])
    np.testing.assert_array_equal(found[core], expected[core])
    np.testing.assert_array_equal(found < 0, expected < 0)
