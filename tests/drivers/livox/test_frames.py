"""Command frames, byte by byte. The vendor's own SDK reads them too: see the conformance test."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.livox.frames import (
    DEVICE_TYPE_MID360,
    Command,
    Destination,
    Discovered,
    Frame,
    Key,
    KeyValue,
    decode_destination,
    decode_discovered,
    decode_frame,
    decode_inquiry,
    decode_inquiry_reply,
    decode_key_values,
    decode_set_reply,
    encode_destination,
    encode_discovered,
    encode_frame,
    encode_inquiry,
    encode_inquiry_reply,
    encode_key_values,
    encode_set_reply,
)

DISCOVERY = bytes.fromhex(
    "aa 00 1800 01000000 0000 00 00 000000000000 a91f 00000000",
)
NORMAL_MODE = bytes.fromhex(
    "aa 00 2100 07000000 0001 00 00 000000000000 5223 6fd5e7ad  0100 0000  1a00 0100 01"
)
NORMAL_MODE_ACK = bytes.fromhex(
    "aa 00 1b00 07000000 0001 01 01 000000000000 12e8 12d941ff  00 0000"
)
GOLDEN = [
    (DISCOVERY, Frame(1, Command.DISCOVER, False, False, b"")),
    (
        NORMAL_MODE,
        Frame(
            7,
            Command.SET,
            False,
            False,
            encode_key_values([KeyValue(Key.WORK_TARGET, b"\x01")]),
        ),
    ),
    (NORMAL_MODE_ACK, Frame(7, Command.SET, True, True, encode_set_reply(0, 0))),
]


def crc(data, width, polynomial, initial, reflected):
    """A check sum bit by bit, as textbooks define it."""
    register, mask = initial, (1 << width) - 1
    for byte in data:
        if reflected:
            register ^= byte
            for _ in range(8):
                register = (register >> 1) ^ polynomial if register & 1 else register >> 1
        else:
            register ^= byte << (width - 8)
            for _ in range(8):
                top = register >> (width - 1)
                register = ((register << 1) ^ polynomial if top else register << 1) & mask
    return register


@pytest.mark.parametrize(("datagram", "frame"), GOLDEN)
def test_a_frame_is_these_bytes_and_no_others(datagram, frame):
    assert encode_frame(frame) == datagram
    assert decode_frame(datagram) == frame


@pytest.mark.parametrize("datagram", [datagram for datagram, _ in GOLDEN])
def test_the_check_sums_are_ccitt_false_over_18_bytes_and_crc32_over_the_data(datagram):
    assert crc(datagram[:18], 16, 0x1021, 0xFFFF, False).to_bytes(2, "little") == datagram[18:20]
    data_crc = crc(datagram[24:], 32, 0xEDB88320, 0xFFFFFFFF, True) ^ 0xFFFFFFFF
    assert data_crc.to_bytes(4, "little") == datagram[20:24]


def test_a_discovery_reply_is_24_bytes_as_published():
    found = Discovered(DEVICE_TYPE_MID360, "47MDK1A0030123", "192.168.1.123", 56100)
    data = bytes.fromhex("00 09 34374d444b314130303330313233 0000 c0a8017b 24db")
    assert encode_discovered(found) == data
    assert decode_discovered(data) == found


def test_a_destination_is_address_port_and_source_port():
    value = bytes.fromhex("c0a80105 eddb ecdb")
    assert encode_destination(Destination("192.168.1.5", 56301, 56300)) == value
    assert decode_destination(value) == Destination("192.168.1.5", 56301, 56300)


entries = st.lists(st.builds(KeyValue, st.integers(0, 0xFFFF), st.binary(max_size=40)), max_size=12)


@given(entries)
def test_key_value_lists_survive_the_wire(written):
    assert decode_key_values(encode_key_values(written)) == tuple(written)
    assert decode_inquiry_reply(encode_inquiry_reply(0, written)) == (0, tuple(written))


@given(st.lists(st.integers(0, 0xFFFF), max_size=50))
def test_inquiries_survive_the_wire(keys):
    assert decode_inquiry(encode_inquiry(keys)) == tuple(keys)


@given(st.binary(max_size=1500))
def test_no_bytes_whatever_raise(data):
    assert decode_frame(data) is None or len(data) >= 24
    for decode in (
        decode_key_values,
        decode_inquiry,
        decode_inquiry_reply,
        decode_set_reply,
        decode_discovered,
        decode_destination,
    ):
        decode(data)


@given(st.sampled_from([datagram for datagram, _ in GOLDEN]), st.data())
def test_one_flipped_bit_spoils_a_frame(datagram, data):
    bit = data.draw(st.integers(0, 8 * len(datagram) - 1))
    spoilt = bytearray(datagram)
    spoilt[bit // 8] ^= 1 << bit % 8
    assert decode_frame(bytes(spoilt)) is None


@given(st.sampled_from([datagram for datagram, _ in GOLDEN]), st.data())
def test_a_frame_cut_or_prolonged_is_none(datagram, data):
    size = data.draw(st.integers(0, len(datagram) - 1))
    assert decode_frame(datagram[:size]) is None
    assert decode_frame(datagram + b"\0") is None
