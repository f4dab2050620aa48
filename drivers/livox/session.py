"""How a MID-360 is brought to sampling, and brought back when it falls silent. No I/O.

Ask who it is -> tell it where to send, what and that it shall work -> wait (6-10 s from idle) until
points come. There is no heart beat: once told, it streams; silence means it was off or rebooted,
and is answered by telling it again. Times are mission seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

from config.sensors import Lidar
from drivers.livox.frames import (
    Command,
    Destination,
    Frame,
    Key,
    KeyValue,
    Return,
    WorkState,
    decode_inquiry_reply,
    decode_key_values,
    decode_set_reply,
    encode_destination,
    encode_frame,
    encode_inquiry,
    encode_key_values,
    integer,
    text,
)
from drivers.livox.packets import DataType
from drivers.livox.statistics import Link

RETRY_S = 0.5
SILENCE_S = 1.0
START_S = 20.0
"""Longest wait for points after a configuration; the slowest start seen is 13.6 s."""
_ASKED = (Key.SERIAL, Key.FIRMWARE_TYPE, Key.WORK_STATE, Key.TEMPERATURE, Key.HEALTH)
_HEALTH_ERROR_LEVEL = 3
_DIRTY_WINDOW = 0x0104


@dataclass(slots=True)
class Device:
    """What the sensor has said of itself."""

    serial: str = ""
    work_state: int = 0
    temperature_c: float | None = None
    health: str = ""


class Session:
    """The conversation with one sensor."""

    def __init__(self, settings: Lidar) -> None:
        self._settings = settings
        self._sequence = 0
        self._next_s = float("-inf")
        self._since_s = 0.0
        self._known = False
        self._refusal = ""
        self.link = Link.CONFIGURING
        self.device = Device()
        self.configured = 0

    @property
    def warning(self) -> str:
        """What a person should know; empty when all is well."""
        return self._refusal or self.device.health

    def on_points(self, now_s: float) -> None:
        """Tell that points have come."""
        self._since_s = now_s
        if self.link is Link.WAITING:
            self.link = Link.STREAMING

    def listen_again(self, now_s: float) -> None:
        """Tell that nobody has listened for points until now: silence counts from here."""
        self._since_s = now_s

    def poll(self, now_s: float) -> list[bytes]:
        """Return the datagrams to be sent now."""
        silent_s = now_s - self._since_s
        if (self.link is Link.STREAMING and silent_s > SILENCE_S) or (
            self.link is Link.WAITING and silent_s > START_S
        ):
            self.link, self._known, self._next_s = Link.CONFIGURING, False, now_s
        if now_s < self._next_s or self.link is Link.STREAMING:
            return []
        self._next_s = now_s + RETRY_S
        if self.link is Link.WAITING or not self._known:
            return [self._request(Command.INQUIRE, encode_inquiry(_ASKED))]
        return [self._request(Command.SET, encode_key_values(self._wanted()))]

    def on_frame(self, frame: Frame, now_s: float) -> None:
        """Take in a frame from the sensor."""
        if not frame.from_lidar:
            return
        if frame.command == Command.PUSH and not frame.is_ack:
            self._learn(decode_key_values(frame.data) or ())
        elif frame.command == Command.INQUIRE and frame.is_ack:
            reply = decode_inquiry_reply(frame.data)
            if reply is not None and reply[0] == Return.OK:
                self._learn(reply[1])
                self._identify(now_s)
        elif frame.command == Command.SET and frame.is_ack and self.link is Link.CONFIGURING:
            self._on_set(frame.data, now_s)

    def _identify(self, now_s: float) -> None:
        wanted, serial = self._settings.serial, self.device.serial
        if self.link is not Link.CONFIGURING or self._known or not serial:
            return
        if wanted and serial != wanted:
            self._refusal = f"LiDAR {serial} answers, {wanted} is configured"
            return
        self._refusal = ""
        self._known, self._next_s = True, now_s

    def _on_set(self, data: bytes, now_s: float) -> None:
        reply = decode_set_reply(data)
        if reply is None or not self._known:
            return
        code, error_key = reply
        if code not in {Return.OK, Return.NEEDS_REBOOT}:
            self._refusal = f"LiDAR refuses key 0x{error_key:04X} with code 0x{code:02X}"
            return
        self._refusal = ""
        self.configured += 1
        self.link, self._since_s, self._next_s = Link.WAITING, now_s, now_s + RETRY_S

    def _learn(self, entries: tuple[KeyValue, ...]) -> None:
        device = self.device
        for entry in entries:
            if entry.key == Key.SERIAL:
                device.serial = text(entry.value)
            elif entry.key == Key.WORK_STATE and entry.value:
                device.work_state = entry.value[0]
            elif entry.key == Key.TEMPERATURE and len(entry.value) == 4:
                device.temperature_c = integer(entry.value, signed=True) * 0.01
            elif entry.key == Key.HEALTH:
                device.health = _health(entry.value)

    def _request(self, command: Command, data: bytes) -> bytes:
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        return encode_frame(Frame(self._sequence, command, False, False, data))

    def _wanted(self) -> tuple[KeyValue, ...]:
        to = self._settings

        def destination(port: int, source_port: int) -> bytes:
            return encode_destination(Destination(to.host_ip, port, source_port))

        return (
            KeyValue(Key.POINT_DATA_TYPE, bytes([DataType.CARTESIAN_MM])),
            KeyValue(Key.STATE_DESTINATION, destination(to.host_push_port, 56200)),
            KeyValue(Key.POINT_DESTINATION, destination(to.host_point_port, 56300)),
            KeyValue(Key.IMU_DESTINATION, destination(to.host_imu_port, 56400)),
            KeyValue(Key.IMU_ENABLE, b"\x01"),
            KeyValue(Key.WORK_TARGET, bytes([WorkState.SAMPLING])),
        )


def _health(value: bytes) -> str:
    """Return words for the worst of the health codes (id << 16 | level)."""
    codes = [integer(value[at : at + 4]) for at in range(0, len(value) - 3, 4)]
    worst = max(codes, key=lambda code: code & 0xFF, default=0)
    level, what = worst & 0xFF, worst >> 16
    if what == _DIRTY_WINDOW:
        return "LiDAR window is dirty: clean it"
    return f"LiDAR reports fault 0x{what:04X}" if level >= _HEALTH_ERROR_LEVEL else ""
