import numpy as np
import pytest

from perception.baselines.exposure_clahe import equalised
from perception.baselines.exposure_entropy import KimEntropy, entropy_weighted_gradient
from perception.baselines.exposure_gradient import ShimGradient
from perception.baselines.exposure_metering import MAX_CHANGE_EV, MeanMetering
from perception.baselines.exposure_percentile import ZhangPercentile

RNG = np.random.default_rng(4)
SCENE = np.repeat(np.repeat(RNG.uniform(0.05, 0.4, (12, 16)), 6, 0), 6, 1)


def picture(ev):
    noisy = SCENE * 2.0**ev * RNG.lognormal(0, 0.01, SCENE.shape)
    return np.round(255 * np.clip(noisy, 0, 1) ** (1 / 2.2)).astype(np.uint8)


def settle(controller, ev, frames=40):
    evs = []
    for _ in range(frames):
        ev = min(max(controller.update(picture(ev), ev), -4.0), 4.0)
        evs.append(ev)
    return np.array(evs)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
@pytest.mark.parametrize("start", [-3.0, 3.0])
def test_mean_metering_brings_the_mean_to_its_share(share, start):
    ev = settle(MeanMetering(share, 0.8), start)[-1]
    assert picture(ev).mean() / 255 == pytest.approx(share, abs=0.02)


def test_a_black_picture_moves_it_by_no_more_than_its_bound():
    assert MeanMetering(0.5, 1.4).update(np.zeros((9, 9), np.uint8), 0.0) == MAX_CHANGE_EV


@pytest.mark.parametrize("curve", [None, 0.1])
@pytest.mark.parametrize("start", [-3.5, 2.5])
def test_the_gradient_method_leaves_a_bad_exposure_for_more_gradient(curve, start):
    evs = settle(ShimGradient(1.0, curve), start)
    assert abs(evs[-1]) < abs(start) - 1.0
    assert np.ptp(evs[-5:]) < 0.3


@pytest.mark.parametrize("start", [-3.5, 2.5])
def test_the_soft_percentile_leaves_a_bad_exposure_and_rests(start):
    evs = settle(ZhangPercentile(0.1), start)
    assert 60 < picture(evs[-1]).mean() < 195
    assert np.ptp(evs[-5:]) < 0.3


def test_the_entropy_metric_prefers_the_exposure_that_shows_the_scene():
    right, dark, bright = (entropy_weighted_gradient(picture(ev)) for ev in (1.0, -4.0, 4.0))
    assert right > dark
    assert right > bright


def test_the_entropy_search_settles_near_its_best():
    evs = settle(KimEntropy(-4.0, 4.0, 0.3), -3.5)
    values = [entropy_weighted_gradient(picture(float(np.median(evs[-9:]))))]
    assert values[0] > 0.6 * max(entropy_weighted_gradient(picture(ev)) for ev in range(-4, 5))


def test_clahe_widens_the_greys_of_a_flat_picture():
    flat = picture(-2.5)
    assert equalised(flat, 2.0).std() > 1.2 * flat.std()
