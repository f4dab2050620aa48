"""When a setpoint may leave: no clock but the one that is told."""

import pytest

from mission.processes.dead_man import DECIDED_S, MAX_AGE_S, STALL_S, DeadMan


@pytest.fixture
def flying():
    """One that has sent setpoints up to second 100."""
    dead_man = DeadMan()
    for k in range(20):
        now_s = 99.05 + 0.05 * k
        assert dead_man.look(now_s, engaged=True) is None
        assert dead_man.may_send(now_s, now_s, 99.0)
        dead_man.sent(now_s)
    return dead_man


def test_a_steady_stream_is_no_silence(flying):
    assert flying.look(100.05, engaged=True) is None
    assert flying.sent(100.05) == pytest.approx(0.05)


@pytest.mark.parametrize(("took_s", "leaves"), [(0.0, True), (0.099, True), (0.101, False)])
def test_a_tick_that_took_too_long_is_dropped(flying, took_s, leaves):
    assert flying.may_send(100.05, 100.05 + took_s, 100.0) is leaves
    assert flying.dropped == int(not leaves)
    assert MAX_AGE_S == 0.1


@pytest.mark.parametrize("gap_s", [0.3, 0.39])
def test_a_gap_that_the_autopilot_may_not_mind_is_remembered_for_two_seconds(flying, gap_s):
    now_s = 100.0 + gap_s
    assert flying.look(now_s, engaged=True) is None
    assert flying.may_send(now_s, now_s, 100.0)
    flying.sent(now_s)
    for k in range(1, 39):
        assert flying.look(now_s + 0.05 * k, engaged=True).closed
        flying.sent(now_s + 0.05 * k)
    assert flying.look(now_s + 2.01, engaged=True) is None


@pytest.mark.parametrize("gap_s", [0.41, 0.6, 5.0])
def test_after_a_stall_nothing_leaves_until_the_mode_was_read_anew(flying, gap_s):
    now_s = 100.0 + gap_s
    silence = flying.look(now_s, engaged=True)
    assert silence.from_s == 100.0
    assert silence.read_after_s == max(now_s, 100.0 + DECIDED_S)
    assert not flying.may_send(now_s, now_s, 100.0)
    assert not flying.may_send(now_s, now_s, silence.read_after_s - 0.01)
    assert flying.may_send(now_s, now_s, silence.read_after_s)


def test_the_gap_is_told_until_a_setpoint_closes_it(flying):
    first = flying.look(100.0 + STALL_S + 0.01, engaged=True)
    assert flying.look(103.0, engaged=True) == first
    flying.sent(103.0)
    assert flying.look(103.05, engaged=True).closed


def test_where_the_vehicle_is_not_ours_silence_is_no_gap(flying):
    assert flying.look(105.0, engaged=False) is None
    assert flying.look(105.05, engaged=True) is None
    assert flying.sent(105.05) is None


def test_without_a_mode_nothing_leaves(flying):
    assert not flying.may_send(100.05, 100.05, None)
