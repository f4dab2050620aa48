"""The conversation that brings a sensor to sampling, without a network."""

import struct

import pytest

from config.sensors import Lidar
from drivers.livox.frames import (
    Command,
    Frame,
    Key,
    KeyValue,
    Return,
    decode_frame,
    decode_key_values,
    encode_inquiry_reply,
    encode_key_values,
    encode_set_reply,
)
from drivers.livox.session import RETRY_S, SILENCE_S, START_S, Session
from drivers.livox.statistics import Link


def ack(command, data):
    return Frame(1, command, True, True, data)


def identity(serial=b"47MD1\0"):
    return ack(Command.INQUIRE, encode_inquiry_reply(0, [KeyValue(Key.SERIAL, serial)]))


SET_OK = ack(Command.SET, encode_set_reply(Return.OK, 0))


def commands(datagrams):
    return [decode_frame(datagram).command for datagram in datagrams]


def configured(settings=None):
    session = Session(settings or Lidar())
    session.poll(0.0)
    session.on_frame(identity(), 0.1)
    session.poll(0.1)
    session.on_frame(SET_OK, 0.2)
    return session


def test_it_asks_who_is_there_then_configures_then_waits_then_streams():
    session = Session(Lidar())
    assert commands(session.poll(0.0)) == [Command.INQUIRE]
    session.on_frame(identity(), 0.1)
    assert commands(session.poll(0.1)) == [Command.SET]
    session.on_frame(SET_OK, 0.2)
    assert session.link is Link.WAITING
    session.on_points(8.0)
    assert session.link is Link.STREAMING
    assert session.poll(8.5) == []
    assert session.device.serial == "47MD1"


def test_the_sensor_is_told_destinations_type_and_normal_mode():
    session = Session(Lidar(host_ip="10.0.0.2", host_point_port=5001))
    session.on_frame(identity(), 0.0)
    (datagram,) = session.poll(0.1)
    wanted = {e.key: e.value for e in decode_key_values(decode_frame(datagram).data)}
    assert wanted[Key.POINT_DESTINATION] == bytes([10, 0, 0, 2]) + struct.pack("<HH", 5001, 56300)
    assert wanted[Key.POINT_DATA_TYPE] == b"\x01"
    assert wanted[Key.WORK_TARGET] == b"\x01"


@pytest.mark.parametrize("answered", [False, True])
def test_what_is_not_answered_is_asked_again(answered):
    session = Session(Lidar())
    if answered:
        session.on_frame(identity(), 0.0)
    assert len(session.poll(0.0)) == 1
    assert session.poll(RETRY_S / 2) == []
    assert len(session.poll(RETRY_S)) == 1


def test_silence_while_streaming_is_answered_by_configuring_anew():
    session = configured()
    session.on_points(1.0)
    assert session.poll(1.0 + SILENCE_S) == []
    assert commands(session.poll(1.1 + SILENCE_S)) == [Command.INQUIRE]
    session.on_frame(identity(), 2.2)
    session.poll(2.2)
    session.on_frame(SET_OK, 2.3)
    session.on_points(2.4)
    assert session.link is Link.STREAMING
    assert session.configured == 2


def test_a_sensor_that_never_starts_is_configured_again():
    session = configured()
    session.poll(START_S + 1)
    assert session.link is Link.CONFIGURING


def test_another_serial_number_is_refused_in_words():
    session = Session(Lidar(serial="47MD2"))
    session.on_frame(identity(), 0.0)
    assert commands(session.poll(1.0)) == [Command.INQUIRE]
    assert session.warning == "LiDAR 47MD1 answers, 47MD2 is configured"


def test_a_refused_key_is_named():
    session = Session(Lidar())
    session.on_frame(identity(), 0.0)
    session.poll(0.0)
    session.on_frame(ack(Command.SET, encode_set_reply(Return.WRONG_LENGTH, 5)), 0.1)
    assert session.warning == "LiDAR refuses key 0x0005 with code 0x23"
    assert session.link is Link.CONFIGURING


def test_needs_reboot_is_a_success():
    session = Session(Lidar())
    session.on_frame(identity(), 0.0)
    session.on_frame(ack(Command.SET, encode_set_reply(Return.NEEDS_REBOOT, 4)), 0.1)
    assert session.link is Link.WAITING


def push(*entries):
    return Frame(1, Command.PUSH, False, True, encode_key_values(entries))


def test_pushes_tell_temperature_state_and_a_dirty_window():
    session = configured()
    session.on_frame(
        push(
            KeyValue(Key.WORK_STATE, b"\x01"),
            KeyValue(Key.TEMPERATURE, struct.pack("<i", 4321)),
            KeyValue(Key.HEALTH, struct.pack("<8I", 0x0104 << 16 | 2, *[0] * 7)),
        ),
        1.0,
    )
    assert session.device.work_state == 1
    assert session.device.temperature_c == pytest.approx(43.21)
    assert session.warning == "LiDAR window is dirty: clean it"


def test_frames_of_a_host_are_not_taken_for_the_sensors():
    session = Session(Lidar())
    session.on_frame(Frame(1, Command.INQUIRE, True, False, identity().data), 0.0)
    assert session.device.serial == ""
