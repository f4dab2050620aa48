import pytest

from drivers.simulated.governor import Governor, Load

EASY = Load(renderer_lag_s=0.1, world_lag_s=0.0, busy=0.3)


def settle(governor, load, seconds=60.0):
    factor = 0.0
    for _ in range(int(seconds / 0.05)):
        factor = governor.step(load, 0.05)
    return factor


def test_an_idle_machine_is_driven_to_two_and_a_half_times_real_time_slowly():
    governor = Governor("auto")
    assert settle(governor, EASY, 1.0) < 2.0
    assert settle(governor, EASY) == 2.5


def test_a_busy_machine_is_driven_at_real_time_and_no_slower():
    governor = Governor("auto")
    assert settle(governor, Load(0.1, 0.0, 1.0)) == 1.0


def test_a_fixed_speed_stays_fixed_under_load():
    assert settle(Governor(1.0), Load(0.1, 0.2, 1.0)) == 1.0
    assert settle(Governor(8.0), EASY) == 8.0


@pytest.mark.parametrize("speed", ["auto", 1.0, 10.0])
def test_the_world_stands_for_its_renderer(speed):
    governor = Governor(speed)
    assert 0 < governor.step(Load(0.35, 0.0, 0.3), 0.05) < governor.pace
    assert governor.step(Load(0.5, 0.0, 0.3), 0.05) == 0.0
