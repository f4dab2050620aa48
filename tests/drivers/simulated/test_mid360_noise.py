import numpy as np
import pytest

from drivers.simulated.mid360_noise import TAG_FOG, TAG_MIXED, measure, reported_directions

N = 20_000


def constant(value):
    return np.full(N, value, np.float32)


def seen(range_m, reflectivity=0.8, incidence_deg=0.0, fog_extinction_per_m=0.0):
    return measure(
        constant(range_m),
        constant(np.cos(np.deg2rad(incidence_deg))),
        constant(reflectivity),
        np.random.default_rng(1),
        fog_extinction_per_m=fog_extinction_per_m,
    )


def test_a_surface_at_ten_metres_is_measured_within_two_centimetres():
    returns = seen(10.0)
    assert returns.returned.all()
    assert returns.ranges_m.mean() == pytest.approx(10.0, abs=1e-3)
    assert 0.005 < returns.ranges_m.std() < 0.02
    assert not returns.tag.any()


@pytest.mark.parametrize(("range_m", "reflectivity"), [(40.0, 0.1), (70.0, 0.8)])
def test_the_data_sheets_ranges_are_reached_and_not_much_more(range_m, reflectivity):
    assert seen(range_m, reflectivity).returned.mean() == pytest.approx(0.9, abs=0.02)
    assert seen(range_m * 1.25, reflectivity).returned.mean() < 0.01


def test_grazing_surfaces_return_less_and_noisier():
    assert seen(15.0, incidence_deg=77).returned.mean() > 0.99
    assert seen(15.0, incidence_deg=84).returned.mean() == pytest.approx(0.5, abs=0.05)
    assert seen(15.0, incidence_deg=89.9).returned.mean() < 0.05
    flat, steep = seen(15.0), seen(15.0, incidence_deg=75)
    assert steep.ranges_m.std() > 2 * flat.ranges_m[flat.returned].std()


def test_sky_returns_nothing():
    for nothing in (np.inf, np.nan):
        returns = seen(nothing)
        assert not returns.returned.any()
        assert not returns.ranges_m.any()


def test_mixed_pixels_lie_between_two_surfaces_near_each_other():
    ranges_m = np.where(np.arange(N) // 40 % 2, 10.0, 11.0).astype(np.float32)
    returns = measure(ranges_m, constant(1), constant(0.5), np.random.default_rng(2))
    between = (returns.ranges_m > 10.1) & (returns.ranges_m < 10.9)
    assert 0.005 < between.mean() < 0.03
    assert (returns.tag[between] & TAG_MIXED).mean() == pytest.approx(0.7, abs=0.1)
    far_apart = np.where(ranges_m > 10.5, 30.0, 10.0).astype(np.float32)
    returns = measure(far_apart, constant(1), constant(0.5), np.random.default_rng(2))
    assert not ((returns.ranges_m > 11) & (returns.ranges_m < 29)).any()


def test_fog_takes_the_far_returns_and_gives_near_ones():
    returns = seen(30.0, fog_extinction_per_m=0.08)
    assert (returns.ranges_m > 25).mean() < 0.05
    near = (returns.ranges_m > 0) & (returns.ranges_m < 12)
    assert near.mean() > 0.3
    assert (returns.tag[near] & TAG_FOG).astype(bool).mean() == pytest.approx(0.6, abs=0.05)
    sky = seen(np.inf, fog_extinction_per_m=0.08)
    assert sky.returned.mean() > 0.3


def test_the_same_stream_gives_the_same_returns():
    one, other = seen(20.0), seen(20.0)
    assert (one.ranges_m == other.ranges_m).all()


def test_directions_are_reported_with_less_than_the_published_angular_error():
    rng = np.random.default_rng(3)
    true = rng.standard_normal((N, 3)).astype(np.float32)
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    reported = reported_directions(true, rng)
    assert reported.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(reported, axis=1), 1, atol=1e-4)
    error_deg = np.rad2deg(np.linalg.norm(reported - true, axis=1))
    assert 0.05 < error_deg.mean() < 0.15
