"""The blade in the frame of a position that wanders and jitters."""

import numpy as np
import pytest

from mission.flight.phases.live_offset import LiveOffset


def flown(error, *, measured_until=99.0, seconds=8.0):
    """Hover beside a blade with ``error`` (time -> metres) on the position; return what is missed.

    Offsets are measured ten times a second, as the mean over two tenths, and told 0.1 s late.
    """
    live, missed = LiveOffset(), []
    live.begin(np.zeros(3))
    for tick in range(round(seconds / 0.05)):
        now_s = 0.05 * tick
        live.advance(now_s, np.array([error(now_s), 0.0, 0.0]), np.zeros(3))
        if tick % 2 == 0 and now_s < measured_until:
            then = now_s - 0.1
            seen = np.mean([error(t) for t in np.linspace(then - 0.2, then, 5)])
            live.correct(then, np.array([seen, 0.0, 0.0]), 0.1)
        missed.append(live.value_w[0] - error(now_s))
    return np.array(missed)


def test_a_steady_offset_is_found():
    assert np.abs(flown(lambda _: 0.7)[60:]).max() < 0.01


def test_what_the_position_does_without_moving_is_followed_at_once():
    jitter = flown(lambda t: 0.3 * np.sin(4.0 * t))
    assert np.abs(jitter[80:]).max() < 0.04


def test_velocity_is_not_integrated_for_long_once_the_blade_is_lost():
    lost = flown(lambda t: 0.5 if t < 6.0 else 0.5 + (t - 6.0), measured_until=4.0)
    assert lost[-1] == pytest.approx(-1.95, abs=0.1)


def test_motion_that_the_velocity_explains_moves_no_blade():
    live = LiveOffset()
    live.begin(np.zeros(3))
    for tick in range(60):
        live.advance(0.05 * tick, np.array([0.1 * tick, 0.0, 0.0]), np.array([2.0, 0.0, 0.0]))
        live.correct(0.05 * tick, np.zeros(3), 0.05)
    assert np.abs(live.value_w).max() < 1e-9
