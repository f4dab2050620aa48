import math

import pytest
from pymavlink.dialects.v20 import development as mavlink

from drivers.simulated.px4_modes import Mode, Result

OFFBOARD = (1, 6)


def enter_offboard(flight, east=0.0, north=0.0, up=2.5):
    flight.advance(1.0, lambda tick: flight.setpoint(east, north, up) if tick % 2 == 0 else None)
    flight.client.command(176, *OFFBOARD)
    flight.advance(0.2, lambda tick: flight.setpoint(east, north, up) if tick % 2 == 0 else None)
    assert flight.world.aircraft.commander.mode is Mode.OFFBOARD


def test_what_mavsdk_needs_to_call_a_vehicle_healthy_streams_unasked(flight):
    flight.advance(2.0)
    names = {message.get_type() for message in flight.client.heard}
    assert {
        "HEARTBEAT",
        "SYS_STATUS",
        "HOME_POSITION",
        "EXTENDED_SYS_STATE",
        "BATTERY_STATUS",
    } <= names
    status = flight.client.of("SYS_STATUS")[-1]
    assert status.onboard_control_sensors_health & 0x10000020 == 0x10000020
    beat = flight.client.of("HEARTBEAT")[-1]
    assert (beat.type, beat.autopilot, beat.custom_mode) == (2, 12, Mode.HOLD.custom_mode)


def test_positions_come_at_fifty_hertz_and_states_at_one(flight):
    flight.client.heard.clear()
    flight.advance(4.0)
    assert len(flight.client.of("LOCAL_POSITION_NED")) == pytest.approx(200, abs=2)
    assert len(flight.client.of("EXTENDED_SYS_STATE")) == pytest.approx(4, abs=1)
    assert len(flight.client.of("HEARTBEAT")) == pytest.approx(4, abs=1)


def test_a_change_of_mode_is_told_at_once(flight):
    flight.client.heard.clear()
    flight.client.command(176, 1, 3)
    flight.advance(0.12)
    assert flight.client.of("HEARTBEAT")[-1].custom_mode == Mode.POSCTL.custom_mode


def test_message_intervals_are_honoured(flight):
    assert flight.ack_of(511, 436, 100_000) == Result.ACCEPTED
    assert flight.ack_of(511, 32, -1) == Result.ACCEPTED
    flight.client.heard.clear()
    flight.advance(2.0)
    assert len(flight.client.of("CURRENT_MODE")) == pytest.approx(20, abs=2)
    assert not flight.client.of("LOCAL_POSITION_NED")
    assert flight.ack_of(511, 9999, 100_000) == Result.UNSUPPORTED


@pytest.mark.parametrize(
    ("number", "params", "result"),
    [
        (31000, (), Result.UNSUPPORTED),
        (512, (242,), Result.ACCEPTED),
        (512, (9999,), Result.UNSUPPORTED),
        (512, (math.nan,), Result.ACCEPTED),
        (176, (math.nan, math.nan), Result.DENIED),
        (176, OFFBOARD, Result.TEMPORARILY_REJECTED),
    ],
)
def test_every_command_is_acknowledged(flight, number, params, result):
    assert flight.ack_of(number, *params) == result


def test_it_flies_to_a_setpoint_and_holds_when_they_stop(hovering):
    flight = hovering
    enter_offboard(flight)
    flight.advance(6.0, lambda tick: flight.setpoint(4.0, 3.0, 6.0) if tick % 2 == 0 else None)
    body = flight.world.aircraft.body
    assert math.dist((body.x - 80.0, body.y, body.z), (4.0, 3.0, 6.0)) < 1.2
    flight.advance(1.0)
    assert flight.world.aircraft.commander.mode is Mode.HOLD
    # Nobody asked for it, but PX4 goes on when set-points resume.
    flight.advance(0.2, lambda _: flight.setpoint(4.0, 3.0, 6.0))
    assert flight.world.aircraft.commander.mode is Mode.OFFBOARD


@pytest.mark.parametrize("speed", [0.75, 1.5, 2.2])
def test_when_setpoints_stop_it_stops_within_what_px4_was_measured_to_need(hovering, speed):
    flight = hovering
    enter_offboard(flight)
    point = [0.0]

    def lead(tick):
        if tick % 2:
            return
        point[0] += speed * 0.04
        flight.client.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 0x9C0, 0, point[0], -2.5, 0, speed, 0, 0, 0, 0, 0, 0
            )
        )

    flight.advance(8.0, lead)
    start, body = flight.world.aircraft.body.x, flight.world.aircraft.body
    farthest = 0.0
    for _ in range(60):
        flight.advance(0.1)
        farthest = max(farthest, body.x - start)
    assert 0.5 * speed < farthest < 1.1 * speed + speed**2 / 4 + 0.35


def test_messages_for_another_system_are_ignored(flight):
    message = mavlink.MAVLink_command_long_message(7, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    flight.client.send(message)
    flight.advance(0.2)
    assert not flight.world.aircraft.commander.armed
    assert not flight.client.of("COMMAND_ACK")


def test_wild_bytes_are_counted_and_survived(flight):
    for data in (b"", b"\xfd", b"\xfd" * 300, bytes(range(256)), b"hello"):
        flight.client.send_bytes(data)
    flight.advance(0.1)
    assert flight.ack_of(512, 242) == Result.ACCEPTED
    assert flight.world.link.counts.unreadable > 0


def test_a_landing_ends_disarmed_where_it_began(hovering):
    flight = hovering
    assert flight.ack_of(21) == Result.ACCEPTED
    flight.advance(15.0)
    aircraft = flight.world.aircraft
    assert not aircraft.commander.armed
    assert aircraft.body.on_ground
    assert aircraft.body.touchdown_mps < 1.2
    assert flight.client.of("EXTENDED_SYS_STATE")[-1].landed_state == 1


def test_return_climbs_first_then_comes_home_and_lands(hovering):
    flight = hovering
    flight.world.aircraft.parameters.set("RTL_RETURN_ALT", 12.0)
    enter_offboard(flight, 15.0, 0.0, 4.0)
    flight.advance(6.0, lambda tick: flight.setpoint(15.0, 0.0, 4.0) if tick % 2 == 0 else None)
    flight.client.command(20)
    highest, body = 0.0, flight.world.aircraft.body
    for _ in range(90):
        flight.advance(0.5)
        highest = max(highest, body.z)
    assert highest > 11.0
    assert not flight.world.aircraft.commander.armed
    assert flight.world.aircraft.distance_from_launch_m < 2.0


def test_hover_wanders_about_as_much_as_measured(hovering):
    flight = hovering
    enter_offboard(flight)
    places = []

    def hold(tick):
        if tick % 2 == 0:
            flight.setpoint(0.0, 0.0, 2.5)
        places.append(flight.world.aircraft.body.x - 80.0)

    flight.advance(60.0, hold)
    # PX4 with its simulated GNSS: 0.6 m; here an RTK fix wanders.
    assert 0.05 < max(places) - min(places) < 1.6


def test_parameters_are_read_listed_and_set(flight):
    send, heard = flight.client.send, flight.client.of
    send(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1))
    flight.advance(0.1)
    assert heard("PARAM_VALUE")[-1].param_value == 0.5
    send(mavlink.MAVLink_param_set_message(1, 1, b"RTL_RETURN_ALT", 90.0, 9))
    flight.advance(0.1)
    assert flight.world.aircraft.parameters["RTL_RETURN_ALT"] == 90.0
    flight.client.heard.clear()
    send(mavlink.MAVLink_param_request_list_message(1, 1))
    flight.advance(1.0)
    values = heard("PARAM_VALUE")
    assert len({value.param_id for value in values}) == values[0].param_count


def test_a_fence_is_taken_item_by_item(flight):
    send = flight.client.send
    send(mavlink.MAVLink_mission_count_message(1, 1, 2, 1))
    flight.advance(0.1)
    for sequence in range(2):
        assert flight.client.of("MISSION_REQUEST_INT")[-1].seq == sequence
        send(
            mavlink.MAVLink_mission_item_int_message(
                1, 1, sequence, 5, 5003, 0, 0, 100, 0, 0, 0, 0, 0, 0, 1
            )
        )
        flight.advance(0.1)
    assert flight.client.of("MISSION_ACK")[-1].type == 0


def test_files_are_refused_not_ignored(flight):
    flight.client.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, [0] * 251))
    flight.advance(0.1)
    assert flight.client.of("FILE_TRANSFER_PROTOCOL")[-1].payload[3] == 129


def test_setpoint_gaps_are_measured_by_arrival(hovering):
    flight = hovering
    enter_offboard(flight)
    flight.advance(5.0, lambda tick: flight.setpoint(0, 0, 2.5) if tick % 2 == 0 else None)
    mission, _ = flight.world.timing.gaps()
    assert mission.p50 == pytest.approx(40.0, abs=1.0)
    assert mission.count > 100


@pytest.mark.parametrize(
    ("word", "heard"), [("off", 0.0), ("intermittent", 0.75), ("garbage", 0.0), ("slow", 1.0)]
)
def test_a_failing_link_does_what_its_word_says(flight, word, heard):
    flight.world.fault("link", word)
    flight.advance(1.0)
    flight.client.heard.clear()
    flight.advance(4.0)
    share = len(flight.client.of("LOCAL_POSITION_NED")) / 200
    assert share == pytest.approx(heard, abs=0.1)


def test_a_foreign_link_shows_a_foreign_system(flight):
    flight.world.fault("link", "wrong")
    flight.advance(0.1)
    flight.client.heard.clear()
    flight.advance(0.5)
    assert {message.get_srcSystem() for message in flight.client.heard} == {254}


def test_lost_battery_telemetry_is_silence(flight):
    flight.world.fault("battery", "off")
    flight.advance(0.1)
    flight.client.heard.clear()
    flight.advance(3.0)
    assert not flight.client.of("BATTERY_STATUS")
    assert flight.client.of("SYS_STATUS")[-1].battery_remaining == -1
