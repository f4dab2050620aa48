import math

import pytest

from config.report import Report
from drivers.bus import Key
from mission.flight.command import MissionState, Phase, Progress
from mission.flight.observation import FlightMode, Vehicle
from mission.records.course import course_of
from mission.remote.messages import StateMessage, VehicleMessage


def state(t_s, phase=Phase.TRACK, metre=3.0):
    along = phase is Phase.TRACK
    progress = Progress(
        phase,
        MissionState.RUNNING,
        "flying",
        blade="A" if along else "",
        side="PS" if along else "",
        metre=metre if along else None,
        distance_m=12.345 if along else None,
        clearance_m=9.876,
    )
    message = StateMessage(
        vehicle="v",
        mission_dir="",
        site="s",
        mission_s=t_s,
        factor=1.0,
        progress=progress,
        position_w=(1.0, 2.0, 30.0 + t_s),
        battery=0.87654,
    )
    return Key.STATE, message.model_dump_json().encode()


def vehicle(t_s, wind):
    one = Vehicle(
        stamp_s=t_s,
        position_w=(0, 0, 30),
        velocity_w=(0, 0, 0),
        quaternion_wb=(1, 0, 0, 0),
        yaw_rad=0.0,
        mode=FlightMode.OFFBOARD,
        mode_stamp_s=t_s,
        armed=True,
        in_air=True,
        landed=False,
        heartbeat_stamp_s=t_s,
        wind_w=wind,
    )
    return Key.VEHICLE, VehicleMessage(vehicle=one).model_dump_json().encode()


def test_a_row_a_second_is_kept_of_five_states():
    course = course_of(state(0.2 * k) for k in range(50))
    assert len(course.mission_s) == 10
    assert course.distance_m[3] == 12.35
    assert course.battery[0] == 0.877
    assert set(course.leg) == {"A PS"}


def test_between_the_passes_no_leg_is_flown():
    course = course_of([state(0.0), state(1.0, Phase.RETURN)])
    assert course.leg == ("A PS", "")
    assert course.distance_m == (12.35, None)


def test_the_wind_is_told_from_where_it_comes():
    # Blowing towards the east: a west wind, 270 degrees.
    messages = [state(0.0), vehicle(0.0, (4.0, 0.0, 0.0)), state(1.0), vehicle(1.0, (6.0, 0, 0))]
    course = course_of(messages)
    assert course.wind_from_deg == pytest.approx(270.0)
    assert (course.wind_mean_mps, course.wind_max_mps) == (5.0, 6.0)


def test_wind_on_the_ground_and_what_is_broken_are_passed_over():
    course = course_of(
        [(Key.STATE, b"{"), state(0.0, Phase.LANDED), vehicle(0.0, (4.0, 0.0, math.pi))]
    )
    assert course.wind_mean_mps is None
    assert course_of([]).mission_s == ()


@pytest.mark.parametrize("zone", ["Middle/Earth", "", "utc+1"])
def test_a_time_zone_that_does_not_exist_is_refused(zone):
    with pytest.raises(ValueError, match="time zone"):
        Report(time_zone=zone)
