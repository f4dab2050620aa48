"""What a MID-360 answers: its parameters, its work state and its report of it. No I/O.

Times are mission seconds. A real unit takes 6-10 s from idle to sampling and 13.6 s from a reboot
to its first point; the twin is quicker by default, so that a simulation is soon ready.
"""

from __future__ import annotations

import struct

from config.sensors import Lidar
from drivers.livox.frames import (
    DEVICE_TYPE_MID360,
    Command,
    Destination,
    Discovered,
    Frame,
    Key,
    KeyValue,
    Return,
    WorkState,
    decode_destination,
    decode_inquiry,
    decode_key_values,
    encode_discovered,
    encode_inquiry_reply,
    encode_key_values,
    encode_set_reply,
)

_BOOT_SPIN_UPS = 2.0
"""A reboot takes this many times as long as a start from idle."""
_NO_DESTINATION = bytes(8)
_PUSHED = (
    Key.POINT_DATA_TYPE,
    Key.WORK_TARGET,
    Key.SERIAL,
    Key.WORK_STATE,
    Key.TEMPERATURE,
    Key.TIME_SYNC,
    Key.FIRMWARE_TYPE,
    Key.HEALTH,
)


class Firmware:
    """The command side of one simulated sensor.

    Args:
        settings: its own address is stored as a real unit stores it.
        serial: up to 15 ASCII characters.
        spin_up_s: mission time from idle to sampling.
    """

    def __init__(self, settings: Lidar, serial: str, spin_up_s: float) -> None:
        self._serial = serial
        self._lidar_ip = settings.lidar_ip or "127.0.0.1"
        self._command_port = settings.lidar_command_port
        self._spin_up_s = spin_up_s
        self._ready_s = float("-inf")
        self._booting = False
        self._values = _factory_values(serial)
        self.boots = 1
        """Counts every start; the packet counters and the sensor's clock start anew with it."""

    def destination(self, key: Key) -> Destination | None:
        """Return where a stream goes; None before it was told."""
        found = decode_destination(self._values[key])
        return found if found is not None and found.port else None

    def work_state(self, now_s: float) -> WorkState:
        """Return what the sensor does at a mission time."""
        if now_s < self._ready_s:
            return WorkState.SELF_CHECK if self._booting else WorkState.MOTOR_START
        if self._values[Key.WORK_TARGET] == bytes([WorkState.SAMPLING]):
            return WorkState.SAMPLING
        return WorkState.IDLE

    def answer(self, frame: Frame, now_s: float) -> Frame | None:
        """Return the reply to a frame; None where there is none."""
        if frame.from_lidar or frame.is_ack:
            return None
        if frame.command == Command.DISCOVER:
            data = encode_discovered(
                Discovered(DEVICE_TYPE_MID360, self._serial, self._lidar_ip, self._command_port)
            )
        elif frame.command == Command.INQUIRE:
            data = self._inquire(frame.data, now_s)
        elif frame.command == Command.SET:
            data = self._set(frame.data, now_s)
        elif frame.command == Command.REBOOT:
            data = bytes([Return.OK])
            self.boots += 1
            self._booting, self._ready_s = True, now_s + _BOOT_SPIN_UPS * self._spin_up_s
        else:
            data = bytes([Return.UNSUPPORTED])
        return Frame(frame.sequence, frame.command, True, True, data)

    def report(self, sequence: int, now_s: float) -> Frame:
        """Return the state report that is pushed once a second."""
        self._refresh(now_s)
        entries = [KeyValue(key, self._values[key]) for key in _PUSHED]
        return Frame(sequence, Command.PUSH, False, True, encode_key_values(entries))

    def _inquire(self, data: bytes, now_s: float) -> bytes:
        keys = decode_inquiry(data)
        if keys is None:
            return encode_inquiry_reply(Return.WRONG_COUNT, ())
        self._refresh(now_s)
        entries = [KeyValue(key, self._values[key]) for key in keys if key in self._values]
        code = Return.OK if len(entries) == len(keys) else Return.UNSUPPORTED
        return encode_inquiry_reply(code, entries)

    def _set(self, data: bytes, now_s: float) -> bytes:
        entries = decode_key_values(data)
        if entries is None:
            return encode_set_reply(Return.WRONG_COUNT, 0)
        for entry in entries:
            if entry.key not in self._values:
                return encode_set_reply(Return.UNSUPPORTED, entry.key)
            if entry.key >= Key.SERIAL:
                return encode_set_reply(Return.READ_ONLY, entry.key)
            if len(entry.value) != len(self._values[entry.key]):
                return encode_set_reply(Return.WRONG_LENGTH, entry.key)
        before = self.work_state(now_s)
        self._values.update({entry.key: entry.value for entry in entries})
        if before is WorkState.IDLE and self.work_state(now_s) is WorkState.SAMPLING:
            self._booting, self._ready_s = False, now_s + self._spin_up_s
        return encode_set_reply(Return.OK, 0)

    def _refresh(self, now_s: float) -> None:
        self._values[Key.WORK_STATE] = bytes([self.work_state(now_s)])
        self._values[Key.LOCAL_TIME] = struct.pack("<Q", max(0, int(now_s * 1e9)))


def _factory_values(serial: str) -> dict[int, bytes]:
    """Return every parameter known, as a new unit has it."""
    return {
        Key.POINT_DATA_TYPE: b"\x01",
        Key.PATTERN: b"\x00",
        Key.LIDAR_IP: bytes(12),
        Key.STATE_DESTINATION: _NO_DESTINATION,
        Key.POINT_DESTINATION: _NO_DESTINATION,
        Key.IMU_DESTINATION: _NO_DESTINATION,
        Key.INSTALL_ATTITUDE: bytes(24),
        Key.FOV_0: bytes(20),
        Key.FOV_1: bytes(20),
        Key.FOV_ENABLE: b"\x00",
        Key.DETECT_MODE: b"\x00",
        Key.WORK_TARGET: bytes([WorkState.IDLE]),
        Key.IMU_ENABLE: b"\x00",
        Key.SERIAL: serial.encode("ascii")[:15].ljust(16, b"\0"),
        Key.PRODUCT_INFO: b"MID-360 simulated".ljust(64, b"\0"),
        Key.VERSION_APP: bytes((13, 18, 2, 44)),
        Key.VERSION_LOADER: bytes((13, 18, 2, 44)),
        Key.VERSION_HARDWARE: bytes((1, 0, 0, 0)),
        Key.MAC: bytes((2, 0, 0, 0, 0, 1)),
        Key.WORK_STATE: bytes([WorkState.IDLE]),
        Key.TEMPERATURE: struct.pack("<i", 4500),
        Key.LOCAL_TIME: bytes(8),
        Key.LAST_SYNC_TIME: bytes(8),
        Key.TIME_OFFSET: bytes(8),
        Key.TIME_SYNC: b"\x00",
        Key.DIAGNOSTICS: bytes(2),
        Key.FIRMWARE_TYPE: b"\x01",
        Key.HEALTH: bytes(32),
    }
