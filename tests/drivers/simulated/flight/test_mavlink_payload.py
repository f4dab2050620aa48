import math
import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import development as mavlink

from drivers.simulated.link import CameraSetting, StillDone, StillRequest
from drivers.simulated.ned import euler
from drivers.simulated.px4_modes import Result
from perception.geometry import camera_looking_along, rotation_from_quaternion

CAMERA, GIMBAL = 100, 154


def stills(flight):
    return [message for message in flight.to_renderer if isinstance(message, StillRequest)]


def set_param(flight, name, kind, value):
    packed = struct.pack("<i" if kind == 6 else "<f", value).ljust(128, b"\0")
    flight.payload.heard.clear()
    flight.payload.send(
        mavlink.MAVLink_param_ext_set_message(1, CAMERA, name.encode(), packed, kind)
    )
    flight.advance(0.1)
    acks = flight.payload.of("PARAM_EXT_ACK")
    if not acks:
        return None
    raw = acks[-1]._param_value_raw.ljust(4, b"\0")
    return acks[-1].param_result, struct.unpack_from("<f", raw)[0]


def shoot_and_finish(flight, ok=True):
    assert flight.ack_of(2000, 0, 0, 1, 0, component=CAMERA) == Result.ACCEPTED
    request = stills(flight)[-1]
    url = f"http://127.0.0.1:8555/{request.index}.jpg"
    flight.world.payload.camera.still_done(
        StillDone(request.index, request.t_s, url, ok, 0.0, 1 / 1500, 120.0)
    )
    flight.advance(0.5)
    return flight.payload.of("CAMERA_IMAGE_CAPTURED")[-1]


def test_camera_and_gimbal_beat_as_their_own_components(flight):
    beats = flight.payload.of("HEARTBEAT")
    kinds = {(beat.get_srcComponent(), beat.type) for beat in beats}
    assert {(CAMERA, 30), (GIMBAL, 26)} <= kinds


@pytest.mark.parametrize("number", [259, 260, 261, 262, 269, 270])
def test_the_camera_answers_what_mavsdk_asks(flight, number):
    assert flight.ack_of(512, number, component=CAMERA) == Result.ACCEPTED
    assert number in {message.get_msgId() for message in flight.payload.heard}


def test_a_photo_is_acknowledged_and_told_when_it_exists(flight):
    captured = shoot_and_finish(flight)
    assert (captured.image_index, captured.capture_result) == (0, 1)
    assert captured.file_url == "http://127.0.0.1:8555/0.jpg"


def test_a_lost_picture_is_told_again_by_its_index(flight):
    shoot_and_finish(flight)
    assert flight.ack_of(512, 263, 0, component=CAMERA) == Result.ACCEPTED
    assert flight.payload.of("CAMERA_IMAGE_CAPTURED")
    assert flight.ack_of(512, 263, 7, component=CAMERA) == Result.FAILED


def test_a_picture_that_could_not_be_made_is_told_as_failed(flight):
    assert shoot_and_finish(flight, ok=False).capture_result == 0


def test_one_photo_at_a_time(flight):
    assert flight.ack_of(2000, 0, 0, 1, 0, component=CAMERA) == Result.ACCEPTED
    assert flight.ack_of(2000, 0, 0, 1, 0, component=CAMERA) == Result.TEMPORARILY_REJECTED


@pytest.mark.parametrize(
    ("asked", "applied"), [(0.7, 2 / 3), (-9.0, -3.0), (9.0, 3.0), (0.1, 0.0), (-1.0, -1.0)]
)
def test_ev_is_rounded_and_clamped_to_the_list(flight, asked, applied):
    result, value = set_param(flight, "CAM_EV", 9, asked)
    assert (result, value) == (0, pytest.approx(applied, abs=1e-6))
    told = [m for m in flight.to_renderer if isinstance(m, CameraSetting)][-1]
    assert (told.mode, told.ev) == ("manual", pytest.approx(applied))


def test_a_stuck_camera_rejects_ev_and_a_wrong_one_clamps_it(flight):
    flight.world.fault("camera", "stuck")
    assert set_param(flight, "CAM_EV", 9, 1.0) == (1, 0.0)
    flight.world.fault("camera", "wrong")
    assert set_param(flight, "CAM_EV", 9, 2.0) == (0, 1.0)
    flight.world.fault("camera", "off")
    assert set_param(flight, "CAM_EV", 9, 1.0) is None


def test_nan_and_unknown_types_of_ev_are_refused(flight):
    assert set_param(flight, "CAM_EV", 9, math.nan)[0] == 1
    assert set_param(flight, "CAM_SHUTTER", 9, 0.1)[0] == 1
    assert set_param(flight, "CAM_SHUTTER", 9, 1 / 4000)[0] == 0


def test_the_gimbal_moves_only_for_who_holds_it(flight):
    assert flight.ack_of(1000, -20, 0, component=GIMBAL) == Result.DENIED
    assert flight.ack_of(1001, 1, 191, component=GIMBAL) == Result.ACCEPTED
    assert flight.ack_of(1000, -20, 10, 0, 0, 0, component=GIMBAL) == Result.ACCEPTED
    flight.advance(2.0)
    gimbal = flight.world.payload.gimbal
    assert math.degrees(gimbal.pitch_rad) == pytest.approx(-20, abs=0.1)
    assert math.degrees(gimbal.yaw_rad) == pytest.approx(10, abs=0.1)


def test_limits_and_rate_hold(flight):
    flight.ack_of(1001, 1, 191, component=GIMBAL)
    flight.payload.command(1000, -200, 170, 0, 0, 0, component=GIMBAL)
    gimbal, fastest, before = flight.world.payload.gimbal, 0.0, 0.0
    for _ in range(300):
        flight.advance(0.02)
        fastest, before = max(fastest, abs(gimbal.pitch_rad - before) / 0.02), gimbal.pitch_rad
    assert math.degrees(gimbal.pitch_rad) == pytest.approx(-90, abs=0.1)
    assert math.degrees(gimbal.yaw_rad) == pytest.approx(60, abs=0.1)
    assert math.degrees(fastest) <= 60.1


def test_a_locked_aim_looks_north_and_the_truth_says_so(flight):
    flight.ack_of(1001, 1, 191, component=GIMBAL)
    heading = math.degrees(euler(flight.world.aircraft.telemetry.ned_q)[2])
    flight.payload.command(1000, 15, heading + 30, 0, 0, 16 | 64, component=GIMBAL)
    flight.advance(2.0)
    truth = flight.to_renderer[-1]
    yaw = math.radians(90 - heading - 30)
    towards = np.array([math.cos(yaw), math.sin(yaw), math.tan(math.radians(15))])
    looked = rotation_from_quaternion(truth.camera_quaternion_wc)
    expected = camera_looking_along(towards)
    # Within the autopilot's heading error (1 deg, one sigma).
    np.testing.assert_allclose(looked, expected, atol=0.06)
    report = flight.payload.of("GIMBAL_DEVICE_ATTITUDE_STATUS")[-1]
    assert report.flags & 64
    assert math.degrees(euler(report.q)[1]) == pytest.approx(15, abs=0.2)


def test_attitude_comes_at_thirty_hertz(flight):
    flight.payload.heard.clear()
    flight.advance(2.0)
    assert len(flight.payload.of("GIMBAL_DEVICE_ATTITUDE_STATUS")) == pytest.approx(60, abs=4)


@pytest.mark.parametrize(("word", "pitch"), [("stuck", 0.0), ("wrong", -30.0), ("off", 0.0)])
def test_a_failing_gimbal_does_what_its_word_says(flight, word, pitch):
    flight.ack_of(1001, 1, 191, component=GIMBAL)
    flight.world.fault("gimbal", word)
    flight.payload.command(1000, -20, 0, 0, 0, 0, component=GIMBAL)
    flight.advance(3.0)
    assert math.degrees(flight.world.payload.gimbal.pitch_rad) == pytest.approx(pitch, abs=0.2)
