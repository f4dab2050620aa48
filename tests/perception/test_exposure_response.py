import numpy as np
import pytest

from perception.exposure_response import Response


def filmic(x):
    curve = (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)
    return 255 * np.clip(curve, 0, 1) ** (1 / 2.2)


def histogram(light, ev, seed=0):
    grain = np.random.default_rng(seed).lognormal(0, 0.02, light.size)
    greys = np.round(filmic(light * 2.0**ev * grain)).astype(int)
    return np.bincount(greys, minlength=256)


SCENE = np.geomspace(0.02, 2.0, 5000)


def error_ev(response, change):
    """Of the change of EV read off two greys, worst over the middle of the range."""
    light = np.geomspace(0.08, 0.4, 9)
    found = [
        response.ev_at(float(b)) - response.ev_at(float(a))
        for a, b in zip(filmic(light), filmic(light * 2.0**change), strict=True)
    ]
    return max(abs(one - change) for one in found)


def test_one_change_of_exposure_tells_most_of_the_curve():
    response = Response()
    before = error_ev(response, 1.0)
    assert response.learn(histogram(SCENE, -0.5), histogram(SCENE, 0.5, seed=1), 1.0)
    assert error_ev(response, 1.0) < 0.5 * before


def test_many_changes_tell_it_to_a_tenth_of_an_ev():
    response = Response()
    rng = np.random.default_rng(1)
    for _ in range(20):
        ev, change = rng.uniform(-1.5, 1.0), rng.choice([-1.0, -0.67, 0.67, 1.0])
        response.learn(histogram(SCENE, ev), histogram(SCENE, ev + change), float(change))
    assert error_ev(response, 1.0) < 0.1


def test_a_change_of_the_light_against_that_of_the_exposure_is_not_believed():
    response = Response()
    assert not response.learn(histogram(SCENE, 0.0), histogram(SCENE, -1.0), 1.0)
    assert error_ev(response, 1.0) == error_ev(Response(), 1.0)


@pytest.mark.parametrize("grey", [0, 255])
def test_pictures_all_black_or_all_white_say_nothing(grey):
    flat = np.bincount([grey] * 100, minlength=256)
    response = Response()
    assert not response.learn(flat, flat, 1.0)


def test_the_curve_inverts():
    response = Response()
    assert response.grey_at(response.ev_at(97.0)) == pytest.approx(97.0)
