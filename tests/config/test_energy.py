import pytest
from hypothesis import given
from hypothesis import strategies as st

from config.airframe import Airframe, Battery
from config.energy import hover_s, leg_s, leg_wh, must_return_at, power_w, share_home

BATTERY, AIRFRAME = Battery(), Airframe()
metres = st.floats(-150, 150)
positions = st.tuples(metres, metres, st.floats(0, 150))
winds = st.tuples(st.floats(-10, 10), st.floats(-10, 10), st.just(0.0))


def test_hovering_in_still_air_draws_the_hover_power():
    assert power_w(BATTERY, (0, 0, 0)) == BATTERY.hover_w


def test_drifting_with_the_wind_costs_no_more_than_hovering_in_still_air():
    assert power_w(BATTERY, (5, 0, 0), (5, 0, 0)) == BATTERY.hover_w


def test_hovering_in_wind_costs_the_drag_of_its_airspeed():
    assert power_w(BATTERY, (0, 0, 0), (0, 10, 0)) == pytest.approx(
        BATTERY.hover_w + BATTERY.drag_w_per_mps3 * 1000
    )


def test_climbing_costs_and_descending_is_not_credited():
    climb = power_w(BATTERY, (0, 0, 2)) - power_w(BATTERY, (0, 0, -2))
    assert climb == pytest.approx(2 * BATTERY.climb_w_per_mps)


def test_a_full_battery_hovers_half_an_hour_down_to_the_reserve():
    assert hover_s(BATTERY) == pytest.approx(0.8 * 500 / 800 * 3600)
    assert hover_s(BATTERY, charge=BATTERY.reserve) == 0
    assert hover_s(BATTERY, charge=0.0) == 0


def test_a_leg_that_goes_nowhere_costs_nothing():
    assert leg_s(AIRFRAME, (1, 2, 3), (1, 2, 3), 2.0) == 0
    assert leg_wh(BATTERY, AIRFRAME, (1, 2, 3), (1, 2, 3), 2.0) == 0


def test_a_steep_climb_takes_as_long_as_the_climb_rate_allows():
    assert leg_s(AIRFRAME, (0, 0, 0), (0, 0, 90), 6.0) == pytest.approx(30 + 3)


def test_a_level_leg_costs_power_times_time():
    duration = leg_s(AIRFRAME, (0, 0, 50), (120, 0, 50), 6.0)
    assert duration == pytest.approx(26)
    energy = leg_wh(BATTERY, AIRFRAME, (0, 0, 50), (120, 0, 50), 6.0)
    assert energy == pytest.approx(power_w(BATTERY, (120 / 26, 0, 0)) * 26 / 3600)


@given(positions, winds)
def test_home_from_further_out_never_costs_less(position, wind):
    further = (position[0] * 1.5, position[1] * 1.5, position[2])
    near = share_home(BATTERY, AIRFRAME, position, (0, 0, 0), 140.0)
    far = share_home(BATTERY, AIRFRAME, further, (0, 0, 0), 140.0)
    assert 0 <= near <= far + 1e-12
    against = share_home(BATTERY, AIRFRAME, position, (0, 0, 0), 140.0, wind)
    assert against < 1


def test_headwind_home_costs_more_than_tailwind():
    out = (100.0, 0.0, 80.0)
    against = share_home(BATTERY, AIRFRAME, out, (0, 0, 0), 80.0, (8.0, 0, 0))
    along = share_home(BATTERY, AIRFRAME, out, (0, 0, 0), 80.0, (-2.0, 0, 0))
    assert against > along


@given(positions, winds)
def test_the_way_home_begins_before_the_reserve_and_before_the_autopilots_own_return(
    position, wind
):
    charge = must_return_at(BATTERY, AIRFRAME, position, (0, 0, 0), 140.0, wind)
    home = share_home(BATTERY, AIRFRAME, position, (0, 0, 0), 140.0, wind)
    assert charge - home >= BATTERY.reserve - 1e-12
    assert charge >= BATTERY.autopilot_return_at + 0.05
