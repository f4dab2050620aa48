import math

import numpy as np
import pytest

from perception.frame_drift import FrameDrift

EAST = np.array([1.0, 0.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])


def test_there_is_no_drift_when_the_rotor_is_measured():
    drift, covariance = FrameDrift(1.5, 60.0, 100.0).at(100.0)
    np.testing.assert_allclose(drift, 0.0)
    np.testing.assert_allclose(covariance, 0.0, atol=1e-12)


def test_long_after_two_wanders_are_unknown():
    _, covariance = FrameDrift(1.5, 60.0, 0.0).at(1e4)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), 1.5 * math.sqrt(2))


def test_a_measurement_tells_its_own_direction_only():
    filter_ = FrameDrift(1.5, 60.0, 0.0)
    assert filter_.measure(300.0, EAST, 2.0, 0.1)
    drift, covariance = filter_.at(300.0)
    assert drift[0] == pytest.approx(2.0, abs=0.02)
    assert np.abs(drift[1:]).max() < 1e-9
    assert math.sqrt(covariance[0, 0]) == pytest.approx(0.1, abs=0.01)
    assert math.sqrt(covariance[2, 2]) > 2.0


def test_what_was_measured_fades():
    filter_ = FrameDrift(1.5, 60.0, 0.0)
    filter_.measure(300.0, UP, 1.0, 0.05)
    soon, later = filter_.at(310.0)[1][2, 2], filter_.at(400.0)[1][2, 2]
    assert 0.05**2 < soon < later < 2 * 1.5**2


def test_what_is_too_far_off_is_left_out():
    filter_ = FrameDrift(0.2, 60.0, 0.0)
    assert not filter_.measure(300.0, EAST, 6.0, 0.3)
    np.testing.assert_allclose(filter_.at(300.0)[0], 0.0)


def test_the_filter_is_honest_about_a_wander_that_it_follows():
    rng = np.random.default_rng(3)
    sigma, time_s, step_s = 1.5, 60.0, 3.0
    decay = math.exp(-step_s / time_s)
    scaled = []
    for _ in range(150):
        filter_ = FrameDrift(sigma, time_s, 0.0)
        wander = start = rng.normal(0.0, sigma, 3)
        for tick in range(1, 31):
            fresh = sigma * math.sqrt(1 - decay**2) * rng.normal(size=3)
            wander = wander * decay + fresh
            direction = EAST if tick % 2 else UP
            seen = float((wander - start) @ direction) + rng.normal(0.0, 0.3)
            filter_.measure(tick * step_s, direction, seen, 0.3)
        drift, covariance = filter_.at(30 * step_s)
        scaled.append((drift - (wander - start)) / np.sqrt(np.diag(covariance)))
    spread = np.sqrt(np.mean(np.square(scaled), axis=0))
    assert (spread > 0.8).all()
    assert (spread < 1.2).all()


def test_what_the_position_moves_beyond_the_velocity_is_followed():
    filter_ = FrameDrift(1.5, 60.0, 0.0)
    for tick in range(400):
        stamp_s = 0.05 * tick
        # Flown north at 1 m/s; the position wanders east at 0.1 m/s besides.
        filter_.move(stamp_s, np.array([0.1 * stamp_s, stamp_s, 0.0]), np.array([0.0, 1.0, 0.0]))
    drift, covariance = filter_.at(20.0)
    assert drift[0] == pytest.approx(2.0, abs=0.35)
    assert abs(drift[1]) < 1e-6
    alone = FrameDrift(1.5, 60.0, 0.0).at(20.0)[1]
    assert covariance[0, 0] < 0.4 * alone[0, 0]


def test_a_gap_in_the_reports_is_not_integrated_over():
    filter_ = FrameDrift(1.5, 60.0, 0.0)
    filter_.move(1.0, np.zeros(3), np.zeros(3))
    filter_.move(5.0, np.array([40.0, 0.0, 0.0]), np.zeros(3))
    np.testing.assert_allclose(filter_.at(5.0)[0], 0.0)


def test_a_sighting_counts_in_the_directions_in_which_it_is_sure():
    filter_ = FrameDrift(1.5, 60.0, 0.0)
    filter_.see(300.0, np.array([1.0, 9.0, 1.0, 0.0]), np.diag([0.01, 400.0, 0.01, 1.0]))
    drift, covariance = filter_.at(300.0)
    assert drift[[0, 2]] == pytest.approx([1.0, 1.0], abs=0.02)
    assert abs(drift[1]) < 0.2
    assert math.sqrt(covariance[1, 1]) > 2.0


def test_a_heading_is_learnt_beside_and_fades():
    filter_ = FrameDrift(0.2, 60.0, 0.0, heading_sigma_rad=0.02)
    filter_.see(100.0, np.array([0.0, 0.0, 0.0, 0.015]), np.diag([0.01, 0.01, 0.01, 1e-6]))
    heading, sigma = filter_.heading(100.0)
    assert heading == pytest.approx(0.015, abs=1e-3)
    assert sigma < 0.0011
    later, unsure = filter_.heading(300.0)
    assert later < 0.2 * heading
    assert unsure == pytest.approx(0.02, rel=0.05)
