import math

import pytest

from drivers.simulated.px4_modes import (
    Commander,
    Health,
    Landed,
    Mode,
    Result,
    mode_from_custom,
)
from drivers.simulated.px4_parameters import Parameters

FLYING = Health(on_ground=False, height_m=20.0, climb_mps=0.0)
RESTING = Health(on_ground=True, height_m=0.0, climb_mps=0.0)


def in_offboard(parameters=None):
    commander = Commander(parameters or Parameters())
    commander.step(0.0, RESTING)
    assert commander.arm(0.0) is Result.ACCEPTED
    commander.setpoint_received(1.0)
    assert commander.set_mode(Mode.OFFBOARD, 1.0) is Result.ACCEPTED
    commander.step(1.0, FLYING)
    return commander


def pass_time(commander, start_s, end_s, health):
    for i in range(int((end_s - start_s) / 0.02) + 1):
        commander.step(start_s + i * 0.02, health)


def test_offboard_needs_a_fresh_setpoint():
    commander = Commander(Parameters())
    assert commander.set_mode(Mode.OFFBOARD, 10.0) is Result.TEMPORARILY_REJECTED
    commander.setpoint_received(10.0)
    assert commander.set_mode(Mode.OFFBOARD, 10.6) is Result.TEMPORARILY_REJECTED
    assert commander.set_mode(Mode.OFFBOARD, 10.4) is Result.ACCEPTED


def test_setpoints_lost_for_half_a_second_mean_hold_and_their_return_means_offboard_again():
    commander = in_offboard()
    commander.step(1.48, FLYING)
    assert commander.mode is Mode.OFFBOARD
    commander.step(1.52, FLYING)
    assert commander.mode is Mode.HOLD
    assert commander.offboard_losses == 1
    commander.setpoint_received(4.0)
    commander.step(4.0, FLYING)
    # As measured on PX4: nobody asked for it.
    assert commander.mode is Mode.OFFBOARD


def test_offboard_loss_may_return_but_holds_first():
    parameters = Parameters({"COM_OBL_RC_ACT": 3})
    commander = in_offboard(parameters)
    pass_time(commander, 1.0, 3.0, FLYING)
    assert commander.mode is Mode.HOLD
    pass_time(commander, 3.0, 7.0, FLYING)
    assert commander.mode is Mode.RETURN


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.POSCTL, Mode.LAND, Mode.RETURN])
def test_any_user_may_leave_offboard(mode):
    commander = in_offboard()
    assert commander.set_mode(mode, 1.2) is Result.ACCEPTED
    commander.setpoint_received(1.3)
    commander.step(1.3, FLYING)
    assert commander.mode is mode


def test_takeoff_ends_in_hold():
    commander = Commander(Parameters())
    commander.step(0.0, RESTING)
    assert commander.take_off(8.0, 0.0) is Result.ACCEPTED
    assert commander.arm(0.0) is Result.ACCEPTED
    commander.step(1.0, Health(on_ground=False, height_m=3.0, climb_mps=1.5))
    assert (commander.mode, commander.landed) == (Mode.TAKEOFF, Landed.TAKEOFF)
    commander.step(6.0, Health(on_ground=False, height_m=7.9, climb_mps=0.5))
    assert commander.mode is Mode.HOLD


def test_landing_disarms_and_the_mode_from_before_returns():
    commander = in_offboard()
    commander.set_mode(Mode.LAND, 1.1)
    pass_time(commander, 1.2, 6.0, RESTING)
    assert not commander.armed
    assert commander.landed is Landed.ON_GROUND
    assert commander.mode is Mode.OFFBOARD
    assert not commander.armable(6.0)
    commander.set_mode(Mode.HOLD, 6.1)
    assert commander.armable(6.1)


def test_arming_is_denied_in_land_mode_and_hold_clears_it():
    commander = Commander(Parameters())
    commander.step(0.0, RESTING)
    commander.set_mode(Mode.LAND, 0.0)
    assert commander.arm(0.1) is Result.TEMPORARILY_REJECTED
    commander.set_mode(Mode.HOLD, 0.2)
    assert commander.arm(0.2) is Result.ACCEPTED


def test_armed_and_left_alone_on_the_ground_it_disarms():
    commander = Commander(Parameters())
    commander.step(0.0, RESTING)
    commander.arm(0.0)
    pass_time(commander, 0.0, 9.0, RESTING)
    assert commander.armed
    pass_time(commander, 9.0, 11.0, RESTING)
    assert not commander.armed


def test_disarming_in_the_air_needs_force():
    commander = in_offboard()
    assert commander.disarm(1.1) is Result.TEMPORARILY_REJECTED
    assert commander.disarm(1.1, force=True) is Result.ACCEPTED


def test_a_lost_position_ends_in_a_blind_descent():
    commander = in_offboard()
    commander.set_mode(Mode.HOLD, 1.1)
    blind = Health(on_ground=False, height_m=20.0, climb_mps=0.0, position_ok=False)
    pass_time(commander, 1.2, 6.0, blind)
    assert commander.mode is Mode.HOLD
    pass_time(commander, 6.0, 7.0, blind)
    assert commander.mode is Mode.ALTCTL


def test_a_low_battery_returns_and_the_pilot_may_overrule_it():
    commander = in_offboard()
    commander.set_mode(Mode.HOLD, 1.1)
    low = Health(on_ground=False, height_m=20.0, climb_mps=0.0, battery_left=0.06)
    pass_time(commander, 1.2, 6.0, low)
    assert commander.mode is Mode.HOLD
    pass_time(commander, 6.0, 7.0, low)
    assert commander.mode is Mode.RETURN
    commander.set_mode(Mode.POSCTL, 7.1)
    pass_time(commander, 7.1, 9.0, low)
    assert commander.mode is Mode.POSCTL


def test_the_worst_failsafe_wins():
    commander = in_offboard()
    pass_time(
        commander,
        2.0,
        12.0,
        Health(on_ground=False, height_m=20.0, climb_mps=0.0, battery_left=0.01),
    )
    assert commander.mode is Mode.LAND


def test_mode_numbers_are_px4s():
    assert Mode.OFFBOARD.custom_mode == 6 << 16
    assert Mode.HOLD.custom_mode == 4 << 16 | 3 << 24
    assert mode_from_custom(4, 3) is Mode.HOLD
    assert mode_from_custom(6, 9) is Mode.OFFBOARD
    assert mode_from_custom(4, 9) is None


def test_takeoff_without_a_height_takes_the_parameter():
    commander = Commander(Parameters())
    commander.step(0.0, RESTING)
    commander.take_off(math.nan, 0.0)
    assert commander.takeoff_height_m == 2.5
