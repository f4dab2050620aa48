"""Which picture an exposure command on the wire belongs to."""

import struct
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import common as mavlink

from benchmarks.daemon import reached
from benchmarks.daemon_light import LightHeard, LightLag, TimedEv, ordered_ev
from mission.flight.command import MissionState, Phase


def parameter(name, value):
    packed = struct.pack("<f", value).ljust(128, b"\0")
    message = mavlink.MAVLink_param_ext_set_message(1, 100, name, packed, 9)
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=191)))


def heard(asked, ordered):
    """``asked``: when a picture was decoded, 60 ms after it was taken, and the EV asked for."""
    decoded_s = {at_s - 0.06: at_s for at_s, _ in asked}
    wishes = [TimedEv(at_s - 0.06, ev) for at_s, ev in asked]
    return LightHeard(decoded_s, wishes, [TimedEv(*one) for one in ordered])


def test_the_ev_of_a_command_is_read_from_its_bytes():
    assert ordered_ev(parameter(b"CAM_EV", -2 / 3)) == pytest.approx(-2 / 3)
    assert ordered_ev(parameter(b"CAM_EV", 0.0)) == 0.0
    assert ordered_ev(parameter(b"CAM_EV_MIN", 1.0)) is None
    assert ordered_ev(parameter(b"CAM_SHUTTER", 0.001)) is None
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    assert ordered_ev(bytes(beat.pack(mavlink.MAVLink(None)))) is None


def test_a_command_belongs_to_the_first_picture_in_a_row_that_asks_for_it():
    asked = [(1.0, 0.0), (1.1, 0.7), (1.2, 0.7), (1.3, 0.7)]
    assert heard(asked, [(1.24, 0.7)]).lags_ms() == [pytest.approx(140.0)]


def test_an_earlier_row_of_the_same_exposure_is_another_command_s():
    asked = [(1.0, 0.7), (1.1, 0.0), (1.2, 0.7)]
    assert heard(asked, [(1.23, 0.7)]).lags_ms() == [pytest.approx(30.0)]


def test_what_was_asked_for_while_the_camera_was_busy_does_not_hide_the_cause():
    asked = [(1.0, 0.7), (1.1, 1.0)]
    assert heard(asked, [(1.15, 0.7)]).lags_ms() == [pytest.approx(150.0)]


def test_a_command_said_again_and_one_of_nobody_count_nothing():
    assert heard([(1.0, 0.7)], [(1.05, 0.7), (1.6, 0.7)]).lags_ms() == [pytest.approx(50.0)]
    assert heard([(1.0, 0.7)], [(1.05, -0.3)]).lags_ms() == []
    assert LightLag.of([]) is None


@pytest.mark.parametrize(
    ("phase", "state", "there"),
    [
        (Phase.TRACK, MissionState.RUNNING, True),
        (Phase.RETURN, MissionState.RUNNING, False),
        (Phase.LANDED, MissionState.ENDED_SAFELY, False),
    ],
)
def test_a_flight_that_turns_back_is_not_waited_for(phase, state, there):
    up = SimpleNamespace(
        clock=SimpleNamespace(now_s=lambda: 0.0), daemon=SimpleNamespace(check=lambda: None)
    )
    newest = [SimpleNamespace(progress=SimpleNamespace(phase=phase, state=state))]
    assert reached(up, newest, Phase.TRACK) is there
