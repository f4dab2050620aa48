"""Command frames of Livox SDK2: header with CRC-16 and CRC-32, key-value lists, replies.

All little-endian. Decoders take untrusted bytes: they return None and never raise.
"""

from __future__ import annotations

import binascii
import ipaddress
import struct
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum

HEADER_BYTES = 24
MAX_FRAME_BYTES = 1400
DISCOVERY_PORT = 56000
DEVICE_TYPE_MID360 = 9
_SOF = 0xAA
_HEADER = struct.Struct("<BBHIHBB6x")  # without its two checks
_CHECKS = struct.Struct("<HI")
_KEY_VALUE = struct.Struct("<HH")
_COUNT = struct.Struct("<HH")  # number of entries, reserved
_DISCOVERED = struct.Struct("<BB16s4sH")
_DESTINATION = struct.Struct("<4sHH")


class Command(IntEnum):
    """What a frame is about."""

    DISCOVER = 0x0000
    SET = 0x0100
    INQUIRE = 0x0101
    PUSH = 0x0102
    REBOOT = 0x0200


class Key(IntEnum):
    """Parameters of the sensor; from 0x8000 on they can only be read."""

    POINT_DATA_TYPE = 0x0000
    PATTERN = 0x0001
    LIDAR_IP = 0x0004
    STATE_DESTINATION = 0x0005
    POINT_DESTINATION = 0x0006
    IMU_DESTINATION = 0x0007
    INSTALL_ATTITUDE = 0x0012
    FOV_0 = 0x0015
    FOV_1 = 0x0016
    FOV_ENABLE = 0x0017
    DETECT_MODE = 0x0018
    WORK_TARGET = 0x001A
    IMU_ENABLE = 0x001C
    SERIAL = 0x8000
    PRODUCT_INFO = 0x8001
    VERSION_APP = 0x8002
    VERSION_LOADER = 0x8003
    VERSION_HARDWARE = 0x8004
    MAC = 0x8005
    WORK_STATE = 0x8006
    TEMPERATURE = 0x8007
    LOCAL_TIME = 0x8009
    LAST_SYNC_TIME = 0x800A
    TIME_OFFSET = 0x800B
    TIME_SYNC = 0x800C
    DIAGNOSTICS = 0x800E
    FIRMWARE_TYPE = 0x8010
    HEALTH = 0x8011


class WorkState(IntEnum):
    """What the sensor does (key 0x8006) or is asked to do (key 0x001A)."""

    SAMPLING = 1
    IDLE = 2
    ERROR = 4
    SELF_CHECK = 5
    MOTOR_START = 6
    READY = 9


class Return(IntEnum):
    """Return codes of a reply."""

    OK = 0
    FAILED = 1
    UNSUPPORTED = 0x20
    NEEDS_REBOOT = 0x21
    """Stored: a success."""
    READ_ONLY = 0x22
    WRONG_LENGTH = 0x23
    WRONG_COUNT = 0x24


@dataclass(frozen=True, slots=True)
class Frame:
    """One command frame."""

    sequence: int
    command: int
    is_ack: bool
    from_lidar: bool
    data: bytes


@dataclass(frozen=True, slots=True)
class KeyValue:
    """One parameter with its raw value."""

    key: int
    value: bytes


@dataclass(frozen=True, slots=True)
class Discovered:
    """The reply to a discovery."""

    device_type: int
    serial: str
    lidar_ip: str
    command_port: int


@dataclass(frozen=True, slots=True)
class Destination:
    """Where the sensor sends one of its streams (keys 0x0005-0x0007)."""

    ip: str
    port: int
    source_port: int


def encode_frame(frame: Frame) -> bytes:
    """Return the frame's bytes, with both check sums."""
    length = HEADER_BYTES + len(frame.data)
    head = _HEADER.pack(
        _SOF, 0, length, frame.sequence, frame.command, frame.is_ack, frame.from_lidar
    )
    data_crc = zlib.crc32(frame.data) if frame.data else 0
    return head + _CHECKS.pack(binascii.crc_hqx(head, 0xFFFF), data_crc) + frame.data


def decode_frame(datagram: bytes) -> Frame | None:
    """Return the frame in a datagram, or None where it is not one, whole and unharmed."""
    if not HEADER_BYTES <= len(datagram) <= MAX_FRAME_BYTES:
        return None
    sof, version, length, sequence, command, kind, sender = _HEADER.unpack_from(datagram)
    head_crc, data_crc = _CHECKS.unpack_from(datagram, _HEADER.size)
    if sof != _SOF or version != 0 or length != len(datagram) or kind > 1 or sender > 1:
        return None
    data = datagram[HEADER_BYTES:]
    if binascii.crc_hqx(datagram[: _HEADER.size], 0xFFFF) != head_crc:
        return None
    if (zlib.crc32(data) if data else 0) != data_crc:
        return None
    return Frame(sequence, command, kind == 1, sender == 1, data)


def encode_key_values(entries: Sequence[KeyValue]) -> bytes:
    """Return the data of a set request or of a push: count, reserved, entries."""
    return _COUNT.pack(len(entries), 0) + _entries(entries)


def decode_key_values(data: bytes) -> tuple[KeyValue, ...] | None:
    """Return the entries of a set request or of a push."""
    if len(data) < _COUNT.size:
        return None
    count, _ = _COUNT.unpack_from(data)
    return _read_entries(data, _COUNT.size, count)


def encode_inquiry(keys: Iterable[int]) -> bytes:
    """Return the data of an inquiry."""
    wanted = tuple(keys)
    return _COUNT.pack(len(wanted), 0) + struct.pack(f"<{len(wanted)}H", *wanted)


def decode_inquiry(data: bytes) -> tuple[int, ...] | None:
    """Return the keys asked for."""
    if len(data) < _COUNT.size:
        return None
    count, _ = _COUNT.unpack_from(data)
    if len(data) < _COUNT.size + 2 * count:
        return None
    return struct.unpack_from(f"<{count}H", data, _COUNT.size)


def encode_inquiry_reply(code: int, entries: Sequence[KeyValue]) -> bytes:
    """Return the data of the reply to an inquiry."""
    return struct.pack("<BH", code, len(entries)) + _entries(entries)


def decode_inquiry_reply(data: bytes) -> tuple[int, tuple[KeyValue, ...]] | None:
    """Return the code and the entries of the reply to an inquiry."""
    if len(data) < 3:
        return None
    code, count = struct.unpack_from("<BH", data)
    entries = _read_entries(data, 3, count)
    return None if entries is None else (code, entries)


def encode_set_reply(code: int, error_key: int) -> bytes:
    """Return the data of the reply to a set request."""
    return struct.pack("<BH", code, error_key)


def decode_set_reply(data: bytes) -> tuple[int, int] | None:
    """Return the code and the key at fault of the reply to a set request."""
    if len(data) < 3:
        return None
    code, error_key = struct.unpack_from("<BH", data)
    return code, error_key


def encode_discovered(found: Discovered) -> bytes:
    """Return the data of the reply to a discovery."""
    return _DISCOVERED.pack(
        Return.OK,
        found.device_type,
        found.serial.encode("ascii")[:15],
        ipaddress.IPv4Address(found.lidar_ip).packed,
        found.command_port,
    )


def decode_discovered(data: bytes) -> Discovered | None:
    """Return who answered a discovery."""
    if len(data) < _DISCOVERED.size:
        return None
    code, device_type, serial, address, port = _DISCOVERED.unpack_from(data)
    if code != Return.OK or port == 0:
        return None
    return Discovered(device_type, text(serial), str(ipaddress.IPv4Address(address)), port)


def encode_destination(destination: Destination) -> bytes:
    """Return the value of a destination key."""
    packed = ipaddress.IPv4Address(destination.ip).packed
    return _DESTINATION.pack(packed, destination.port, destination.source_port)


def decode_destination(value: bytes) -> Destination | None:
    """Return the destination in a value."""
    if len(value) != _DESTINATION.size:
        return None
    address, port, source_port = _DESTINATION.unpack(value)
    return Destination(str(ipaddress.IPv4Address(address)), port, source_port)


def text(value: bytes) -> str:
    """Return NUL-terminated ASCII; what is not ASCII is replaced."""
    return value.split(b"\0", 1)[0].decode("ascii", "replace")


def integer(value: bytes, *, signed: bool = False) -> int:
    """Return a little-endian integer of any width."""
    return int.from_bytes(value, "little", signed=signed)


def _entries(entries: Sequence[KeyValue]) -> bytes:
    return b"".join(_KEY_VALUE.pack(e.key, len(e.value)) + e.value for e in entries)


def _read_entries(data: bytes, at: int, count: int) -> tuple[KeyValue, ...] | None:
    entries: list[KeyValue] = []
    for _ in range(count):
        if at + _KEY_VALUE.size > len(data):
            return None
        key, length = _KEY_VALUE.unpack_from(data, at)
        at += _KEY_VALUE.size
        if at + length > len(data):
            return None
        entries.append(KeyValue(key, data[at : at + length]))
        at += length
    return tuple(entries)
