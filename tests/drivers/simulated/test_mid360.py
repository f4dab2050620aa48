"""The simulated sensor's bytes and answers; the driver against it is in drivers/livox."""

import struct

import numpy as np
import pytest

from config.sensors import Lidar
from drivers.livox.frames import (
    Command,
    Destination,
    Frame,
    Key,
    KeyValue,
    Return,
    WorkState,
    decode_discovered,
    decode_inquiry_reply,
    decode_key_values,
    decode_set_reply,
    encode_destination,
    encode_inquiry,
    encode_key_values,
)
from drivers.simulated.mid360_faults import StreamFault
from drivers.simulated.mid360_firmware import Firmware
from drivers.simulated.mid360_wire import PACKET, pack_imu, pack_packets, pack_points


def one_packet(**arguments):
    points = np.zeros((96, 3), np.float32)
    points[1] = (1.0, -2.0, 0.5)
    returned = np.zeros(96, bool)
    returned[1] = True
    records = pack_points(points, np.full(96, 100, np.uint8), np.full(96, 4, np.uint8), returned)
    return pack_packets(records, 123456789, 5000, 65535)


def test_a_point_packet_is_these_bytes():
    packet = one_packet()[0].tobytes()
    assert len(packet) == 1380
    assert packet[:36] == bytes.fromhex(
        "00 6405 8e12 6000 ffff 00 01 00 000000000000000000000000 00000000 15cd5b0700000000"
    )
    # A ray marked as outside the window, a return, a ray without one.
    assert packet[36:50] == bytes.fromhex("00000000 00000000 00000000 3c 00")
    assert packet[50:64] == bytes.fromhex("e8030000 30f8ffff f4010000 64 04")
    assert packet[64:78] == bytes(14)


def test_packet_numbers_wrap_and_stamps_go_on():
    records = pack_points(
        np.zeros((288, 3), np.float32), *np.zeros((2, 288), np.uint8), np.zeros(288, bool)
    )
    packets = pack_packets(records, 0, 5000, 65535)
    assert packets["number"].tolist() == [65535, 0, 1]
    assert packets["stamp_ns"].tolist() == [0, 480_000, 960_000]


def test_an_imu_packet_is_60_bytes_with_a_check_sum():
    packet = pack_imu(42, 7, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    assert len(packet) == 60
    assert packet[:24] == bytes.fromhex("00 3c00 0000 0100 0700 00 00 00 000000000000000000000000")
    assert struct.unpack_from("<6f", packet, 36) == (0, 0, 0, 0, 0, 1)


@pytest.fixture
def firmware():
    return Firmware(Lidar(), "47MDSIM", spin_up_s=8.0)


def ask(firmware, command, data=b"", now_s=0.0):
    reply = firmware.answer(Frame(9, command, False, False, data), now_s)
    assert (reply.sequence, reply.command, reply.is_ack, reply.from_lidar) == (9, command, 1, 1)
    return reply.data


def put(firmware, key, value, now_s=0.0):
    return decode_set_reply(
        ask(firmware, Command.SET, encode_key_values([KeyValue(key, value)]), now_s)
    )


def test_it_says_who_it_is(firmware):
    found = decode_discovered(ask(firmware, Command.DISCOVER))
    assert (found.serial, found.lidar_ip, found.command_port) == ("47MDSIM", "192.168.1.100", 56100)
    code, entries = decode_inquiry_reply(
        ask(firmware, Command.INQUIRE, encode_inquiry([Key.SERIAL, Key.WORK_STATE]))
    )
    assert code == Return.OK
    assert entries[0].value == b"47MDSIM".ljust(16, b"\0")
    assert entries[1].value == bytes([WorkState.IDLE])


def test_it_takes_its_time_from_idle_to_sampling(firmware):
    assert put(firmware, Key.WORK_TARGET, b"\x01", now_s=10.0) == (Return.OK, 0)
    assert firmware.work_state(17.9) is WorkState.MOTOR_START
    assert firmware.work_state(18.1) is WorkState.SAMPLING
    put(firmware, Key.WORK_TARGET, b"\x02", now_s=20.0)
    assert firmware.work_state(20.1) is WorkState.IDLE


def test_it_remembers_where_to_send(firmware):
    assert firmware.destination(Key.POINT_DESTINATION) is None
    there = Destination("10.0.0.7", 5000, 56300)
    put(firmware, Key.POINT_DESTINATION, encode_destination(there))
    assert firmware.destination(Key.POINT_DESTINATION) == there


@pytest.mark.parametrize(
    ("key", "value", "reply"),
    [
        (Key.SERIAL, b"x", (Return.READ_ONLY, Key.SERIAL)),
        (Key.WORK_TARGET, b"\x01\x02", (Return.WRONG_LENGTH, Key.WORK_TARGET)),
        (0x0999, b"", (Return.UNSUPPORTED, 0x0999)),
    ],
)
def test_what_cannot_be_set_is_refused_with_its_code_and_key(firmware, key, value, reply):
    assert put(firmware, key, value) == reply


def test_a_reboot_takes_longer_and_starts_a_new_count(firmware):
    put(firmware, Key.WORK_TARGET, b"\x01", now_s=0.0)
    ask(firmware, Command.REBOOT, now_s=20.0)
    assert firmware.boots == 2
    assert firmware.work_state(30.0) is WorkState.SELF_CHECK
    assert firmware.work_state(36.1) is WorkState.SAMPLING


def test_its_report_holds_state_and_temperature(firmware):
    report = firmware.report(3, 0.0)
    assert (report.command, report.is_ack) == (Command.PUSH, False)
    entries = {entry.key: entry.value for entry in decode_key_values(report.data)}
    assert entries[Key.WORK_STATE] == bytes([WorkState.IDLE])
    assert entries[Key.TEMPERATURE] == struct.pack("<i", 4500)


def test_its_own_kind_and_other_replies_are_not_answered(firmware):
    assert firmware.answer(Frame(1, Command.INQUIRE, False, True, b""), 0.0) is None
    assert firmware.answer(Frame(1, Command.INQUIRE, True, False, b""), 0.0) is None


def batches(fault, count):
    records = pack_points(
        np.zeros((96 * count, 3), np.float32),
        *np.zeros((2, 96 * count), np.uint8),
        np.zeros(96 * count, bool),
    )
    return fault.apply(pack_packets(records, 10**9, 5000, 0))


@pytest.mark.parametrize("word", ["off", "stuck", "garbage", "wrong", "slow", "intermittent"])
def test_each_word_really_disturbs_the_stream(word):
    fault = StreamFault(np.random.default_rng(0))
    healthy = [bytes(one.data) for one in batches(fault, 5000)]
    assert fault.disturbed == 0
    fault.word = word
    disturbed = [None if one is None else bytes(one.data) for one in batches(fault, 5000)]
    assert fault.disturbed > 1000
    assert disturbed != healthy


def test_stuck_repeats_the_last_packets_exactly():
    fault = StreamFault(np.random.default_rng(0))
    healthy = [bytes(one.data) for one in batches(fault, 300)]
    fault.word = "stuck"
    assert [bytes(one.data) for one in batches(fault, 416)] == healthy[-208:] * 2


def test_wrong_packets_are_from_elsewhere_short_or_of_another_kind():
    fault = StreamFault(np.random.default_rng(0))
    fault.word = "wrong"
    sent = batches(fault, 4)
    assert [one.foreign for one in sent] == [True, False, False, False]
    assert len(sent[1].data) < PACKET.itemsize
    assert sent[2].data[10] == 7
