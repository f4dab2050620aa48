from random import Random

import numpy as np
import pytest

from config.simulation import Wind
from drivers.simulated.wind import WindField


def blown(wind, seconds, mean=8.0, from_deg=270.0, height=80.0, start=0.0):
    field = WindField(wind, mean, from_deg, 80.0, Random(3))
    steps = int(seconds / 0.02)
    return np.array(
        [field.step(start + i * 0.02, 0.02, height, (0.0, 0.0, 0.0)) for i in range(steps)]
    )


def test_wind_from_the_west_blows_east():
    mean = blown(Wind(turbulence=0.0), 10).mean(axis=0)
    np.testing.assert_allclose(mean, [8.0, 0.0, 0.0], atol=1e-9)


def test_turbulence_has_the_asked_intensity():
    samples = blown(Wind(turbulence=0.15), 6000)
    sigma = samples.std(axis=0)
    assert sigma[0] == pytest.approx(0.15 * 8.0, rel=0.2)
    assert sigma[1] == pytest.approx(0.15 * 8.0, rel=0.2)
    assert 0.5 * sigma[0] < sigma[2] < sigma[0]


def test_the_wind_is_weaker_near_the_ground():
    field = WindField(Wind(), 8.0, 0.0, 80.0, Random(0))
    assert field.mean_at(5.0) < 0.75 * field.mean_at(80.0)


def test_the_gust_comes_once_and_reaches_its_height():
    wind = Wind(turbulence=0.0, gust_mps=12.0, gust_at_s=10.0)
    speed = blown(wind, 40)[:, 0] - 8.0
    assert speed.max() == pytest.approx(12.0, abs=0.05)
    assert (speed[: int(10 / 0.02)] == 0).all()
    assert (speed[int(21 / 0.02) :] == 0).all()
