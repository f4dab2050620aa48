import math

import pytest

from drivers.autopilot_state import VehicleMode, VehicleState, mode_of
from drivers.autopilot_wire import Received
from drivers.clock import MonotonicClock

S = 1_000_000_000


def message(name: str, arrival_s: float = 100.0, **fields: object) -> Received:
    return Received(name, 1, fields, int(arrival_s * S))


def position(boot_s: float, x: float = 0.0, vx: float = 0.0, arrival_s: float = 0.0) -> Received:
    return message(
        "LOCAL_POSITION_NED",
        arrival_s or 100.0 + boot_s,
        time_boot_ms=int(boot_s * 1000),
        x=x,
        y=2.0,
        z=-30.0,
        vx=vx,
        vy=0.0,
        vz=0.5,
    )


def known_state() -> VehicleState:
    state = VehicleState(MonotonicClock())
    state.take(message("HEARTBEAT", base_mode=0x81, custom_mode=6 << 16))
    state.take(position(1.0, x=7.0))
    state.take(message("ATTITUDE_QUATERNION", 101.0, time_boot_ms=1000, q1=1.0, q2=0, q3=0, q4=0))
    return state


def test_nothing_is_told_before_mode_position_and_attitude_are_known() -> None:
    state = VehicleState(MonotonicClock())
    assert state.reading() is None
    state.take(position(1.0))
    assert state.reading() is None


def test_a_reading_is_in_east_north_up() -> None:
    reading = known_state().reading()
    assert reading is not None
    assert reading.position_w == (2.0, 7.0, 30.0)
    assert reading.velocity_w == (0.0, 0.0, -0.5)
    assert reading.yaw_rad == pytest.approx(math.pi / 2)
    assert reading.armed
    assert reading.mode is VehicleMode.OFFBOARD


@pytest.mark.parametrize(
    ("main", "sub", "mode"),
    [
        (6, 0, "offboard"),
        (4, 2, "takeoff"),
        (4, 3, "hold"),
        (4, 5, "return"),
        (4, 6, "land"),
        (4, 4, "pilot"),
        (3, 0, "pilot"),
        (1, 0, "pilot"),
        (0, 0, "unknown"),
    ],
)
def test_whatever_we_do_not_fly_ourselves_is_the_pilots(main: int, sub: int, mode: str) -> None:
    assert mode_of(main << 16 | sub << 24) == mode


def test_a_position_that_waited_on_its_way_keeps_its_own_time() -> None:
    state = known_state()
    state.take(position(1.02, x=7.0, arrival_s=102.5))
    reading = state.reading()
    assert reading is not None
    assert reading.stamp_s == pytest.approx(101.02)


def test_a_step_without_velocity_is_a_reset_and_a_fast_flight_is_none() -> None:
    state = known_state()
    state.take(position(1.02, x=7.1, vx=5.0))
    state.take(position(1.04, x=7.2, vx=5.0))
    state.take(position(1.06, x=9.5, vx=5.0))
    reading = state.reading()
    assert reading is not None
    assert reading.reset_count == 1


def test_the_estimators_own_reset_counter_is_heard() -> None:
    state = known_state()
    for count in (3, 3, 4, 4):
        state.take(message("ODOMETRY", reset_counter=count))
    reading = state.reading()
    assert reading is not None
    assert reading.reset_count == 1


def test_what_is_not_a_number_is_not_taken() -> None:
    state = known_state()
    state.take(message("LOCAL_POSITION_NED", time_boot_ms=2000, x=None, y=0, z=0, vx=0, vy=0, vz=0))
    state.take(message("ATTITUDE_QUATERNION", time_boot_ms=2000, q1=None, q2=0, q3=0, q4=0))
    state.take(message("WIND_COV", wind_x=None, wind_y=1.0, wind_z=0.0))
    reading = state.reading()
    assert reading is not None
    assert reading.position_w == (2.0, 7.0, 30.0)
    assert reading.wind_w is None


def test_an_unknown_charge_is_no_charge_reading() -> None:
    state = known_state()
    state.take(message("BATTERY_STATUS", id=0, battery_remaining=-1))
    reading = state.reading()
    assert reading is not None
    assert reading.battery is None
    state.take(message("BATTERY_STATUS", id=0, battery_remaining=55))
    state.take(message("SYS_STATUS", battery_remaining=12))
    reading = state.reading()
    assert reading is not None
    assert reading.battery == 0.55


def test_what_was_asked_for_is_known_only_of_the_mode_it_was_told_with() -> None:
    state = known_state()
    offboard, hold = 6 << 16, 4 << 16 | 3 << 24
    state.take(message("CURRENT_MODE", custom_mode=hold, intended_custom_mode=offboard))
    state.take(message("HEARTBEAT", custom_mode=hold))
    assert state._intended is VehicleMode.OFFBOARD
    state.take(message("HEARTBEAT", custom_mode=4 << 16 | 5 << 24))
    assert state._intended is None
    state.take(message("CURRENT_MODE", custom_mode=hold, intended_custom_mode=hold))
    assert state._intended is VehicleMode.HOLD
    state.take(message("CURRENT_MODE", custom_mode=hold, intended_custom_mode=0))
    assert state._intended is None


def attitude(boot_s: float, heading_deg: float, yawspeed_dps: float | None) -> Received:
    half = math.radians(heading_deg) / 2
    rate = None if yawspeed_dps is None else math.radians(yawspeed_dps)
    return message(
        "ATTITUDE_QUATERNION", 100.0 + boot_s, time_boot_ms=round(boot_s * 1e3),
        q1=math.cos(half), q2=0, q3=0, q4=math.sin(half),
        rollspeed=0.0, pitchspeed=0.0, yawspeed=rate,
    )  # fmt: skip


def gyro_against_heading_deg(state: VehicleState) -> float:
    reading = state.reading()
    assert reading is not None
    assert reading.gyro_yaw_rad is not None
    return math.degrees(math.remainder(reading.yaw_rad - reading.gyro_yaw_rad, 2 * math.pi))


def test_the_gyros_heading_follows_a_turn_and_not_a_magnet() -> None:
    state = known_state()
    for k in range(40):
        state.take(attitude(2.0 + 0.05 * k, 30.0 * 0.05 * k, 30.0))
    turned = 30.0 * 0.05 * 39
    assert abs(gyro_against_heading_deg(state)) < 1.0
    for k in range(40):
        state.take(attitude(4.0 + 0.05 * k, turned + 15.0 * k / 39, 0.0))
    # NED headings grow clockwise, ENU ones the other way.
    assert gyro_against_heading_deg(state) == pytest.approx(-15.0, abs=1.0)


def test_over_a_gap_the_gyros_heading_goes_with_the_heading() -> None:
    state = known_state()
    state.take(attitude(2.0, 0.0, 0.0))
    state.take(attitude(4.0, 90.0, 0.0))
    assert gyro_against_heading_deg(state) == pytest.approx(0.0, abs=1e-6)


def test_without_rates_there_is_no_heading_of_the_gyro() -> None:
    state = known_state()
    state.take(attitude(2.0, 0.0, None))
    reading = state.reading()
    assert reading is not None
    assert reading.gyro_yaw_rad is None


def test_a_vehicle_without_quaternions_is_taken_by_its_angles() -> None:
    state = VehicleState(MonotonicClock())
    state.take(message("HEARTBEAT", base_mode=0x81, custom_mode=6 << 16))
    state.take(position(1.0))
    angles = {"roll": 0.1, "pitch": -0.2, "yaw": 0.3, "yawspeed": 0.0, "pitchspeed": 0.0}
    state.take(message("ATTITUDE", 101.0, time_boot_ms=1000, **angles))
    reading = state.reading()
    assert reading is not None
    assert reading.yaw_rad == pytest.approx(math.pi / 2 - 0.3)
    state.take(message("ATTITUDE", 101.0, time_boot_ms=1000, **angles | {"yaw": math.nan}))
    state.take(message("ATTITUDE_QUATERNION", 101.0, time_boot_ms=1000, q1=1.0, q2=0, q3=0, q4=0))
    state.take(message("ATTITUDE", 101.1, time_boot_ms=1100, **angles))
    reading = state.reading()
    assert reading is not None
    assert reading.yaw_rad == pytest.approx(math.pi / 2)


def test_a_vehicle_that_does_not_tell_whether_it_landed_is_judged_by_its_height() -> None:
    state = known_state()  # 30 m up, armed
    reading = state.reading()
    assert reading is not None
    assert (reading.in_air, reading.landed) == (True, False)
    state.take(message("HEARTBEAT", base_mode=0x01, custom_mode=6 << 16))
    state.take(message("HOME_POSITION", x=0.0, y=0.0, z=-29.6, altitude=500_000))
    reading = state.reading()
    assert reading is not None
    assert (reading.in_air, reading.landed) == (False, True)
    assert state.altitude_m == pytest.approx(500.4)
    state.take(message("EXTENDED_SYS_STATE", landed_state=2))
    reading = state.reading()
    assert reading is not None
    assert (reading.in_air, reading.landed) == (True, False)


def test_a_vehicle_without_system_status_may_be_armed_when_it_stands_by() -> None:
    state = known_state()
    for status, healthy in ((1, False), (3, True)):
        state.take(message("HEARTBEAT", base_mode=1, custom_mode=6 << 16, system_status=status))
        reading = state.reading()
        assert reading is not None
        assert reading.healthy is healthy
    prearm = {f"onboard_control_sensors_{word}": 0x10000000 for word in ("present", "enabled")}
    state.take(message("SYS_STATUS", **prearm, onboard_control_sensors_health=0))
    reading = state.reading()
    assert reading is not None
    assert not reading.healthy
