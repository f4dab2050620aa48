"""Fog as the synthetic MID-360 scatters it back, which knows nothing of the filter."""

import math

import numpy as np
import pytest

from drivers.simulated.mid360_noise import measure
from perception.air_echoes import AirEchoes
from perception.clearance import OccupancyMemory

EYE = np.array([3.0, -2.0, 40.0])
RAYS = 20_000
FIELD_SR = 2 * math.pi * (math.sin(math.radians(52)) + math.sin(math.radians(7)))


def scan(rng, fog_per_m, *, pole_at_m=None, radius_m=0.25):
    """Return the points (N, 3) of one scan, perhaps with a pole beside the sensor."""
    azimuth = rng.uniform(-math.pi, math.pi, RAYS)
    rise = rng.uniform(-math.sin(math.radians(7)), math.sin(math.radians(52)), RAYS)
    level = np.sqrt(1 - rise**2)
    toward = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), rise], axis=1)
    range_m = np.full(RAYS, np.inf, np.float32)
    if pole_at_m is not None:
        aside = pole_at_m * np.sin(azimuth)
        met = (np.cos(azimuth) > 0) & (np.abs(aside) < radius_m)
        range_m[met] = ((pole_at_m - radius_m) / level)[met]
    out = measure(range_m, np.ones(RAYS, np.float32), np.full(RAYS, 0.6, np.float32), rng,
                  fog_extinction_per_m=fog_per_m)  # fmt: skip
    back = out.returned
    points = EYE + toward * out.ranges_m[:, None]
    return np.asarray(points[back])


@pytest.mark.parametrize("fog_per_m", [0.0005, 0.005, 0.02, 0.052])
def test_fog_alone_never_becomes_an_obstacle(fog_per_m):
    rng = np.random.default_rng(3)
    air, memory = AirEchoes(field_of_view_sr=FIELD_SR), OccupancyMemory(ignore_within_m=1.0)
    found = []
    for k in range(150):
        points = scan(rng, fog_per_m)
        memory.update(points[air.solid(points, EYE)], 0.1 * k, EYE)
        if k >= 20:
            found.append(memory.nearest(EYE))
    assert air.expected_per_m3[1] > 0
    assert found == [None] * 130


@pytest.mark.parametrize("fog_per_m", [0.0, 0.005, 0.02, 0.052])
@pytest.mark.parametrize("pole_at_m", [3.0, 6.0, 9.0, 12.0])
def test_a_pole_of_half_a_metre_is_seen_through_fog(fog_per_m, pole_at_m):
    rng = np.random.default_rng(4)
    air, memory = AirEchoes(field_of_view_sr=FIELD_SR), OccupancyMemory(ignore_within_m=1.0)
    for _ in range(20):
        air.solid(scan(rng, fog_per_m), EYE)
    for k in range(6):
        points = scan(rng, fog_per_m, pole_at_m=pole_at_m)
        memory.update(points[air.solid(points, EYE)], 0.1 * k, EYE)
    place = memory.around(EYE, 20.0)
    assert np.linalg.norm(place - EYE, axis=1).min() == pytest.approx(pole_at_m, abs=0.9)


def test_clear_air_leaves_every_point():
    rng = np.random.default_rng(5)
    air = AirEchoes(field_of_view_sr=FIELD_SR)
    for _ in range(15):
        points = scan(rng, 0.0, pole_at_m=5.0, radius_m=2.0)
        assert air.solid(points, EYE).all()
    assert not air.expected_per_m3.any()


def test_when_the_fog_is_gone_everything_counts_again():
    rng = np.random.default_rng(6)
    air = AirEchoes(field_of_view_sr=FIELD_SR)
    for _ in range(20):
        air.solid(scan(rng, 0.02), EYE)
    shares = [air.solid(scan(rng, 0.0, pole_at_m=8.0), EYE).mean() for _ in range(200)]
    assert shares[-1] == 1.0
