import numpy as np

from perception.bri_clustering import cluster_bri


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
