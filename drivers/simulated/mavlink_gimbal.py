"""The simulated gimbal: manager and device of MAVLink's gimbal protocol v2, with lag and limits.

It stabilises roll and pitch against the horizon and turns in yaw against the airframe, so that an
error of the autopilot's heading is an error of a locked aim, as on a real one. On the wire pitch is
positive up and yaw positive to the right, degrees; the truth goes out as ENU.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from random import Random

from config.sensors import Gimbal
from drivers.simulated.mavlink_autopilot import Command, command_of
from drivers.simulated.mavlink_streams import Telemetry
from drivers.simulated.mavlink_wire import Message, made
from drivers.simulated.ned import euler, product
from drivers.simulated.px4_modes import Result
from drivers.simulated.vehicle import Quaternion
from perception.geometry import quaternion_from_euler

#: Optical axes in FLU, as a quaternion (perception.geometry.FLU_FROM_OPTICAL).
_OPTICAL: Quaternion = (0.5, -0.5, 0.5, -0.5)
_GAIN_PER_S = 9.0
_RATE_LAG_S = 0.035
_JITTER_RAD = math.radians(0.05)
_WRONG_RAD = math.radians(10.0)
_DELAY_S = 0.5
_YAW_LOCK, _VEHICLE_FRAME, _EARTH_FRAME = 16, 32, 64
_STATUS_HZ = 30.0
_ATTITUDE_STATUS = 285


@dataclass(frozen=True, slots=True)
class _Aim:
    pitch_rad: float = 0.0
    """Up."""
    yaw_rad: float = 0.0
    """Right: of north when locked, else of the nose."""
    locked: bool = False


@dataclass(frozen=True, slots=True)
class GimbalTruth:
    """Where the camera really looks."""

    quaternion_wc: Quaternion
    rate_rps: float


class MockGimbal:
    """Gimbal manager and device."""

    def __init__(
        self,
        gimbal: Gimbal,
        manager: int,
        send: Callable[[Message, int], None],
        telemetry: Telemetry,
        seed: int,
    ) -> None:
        self._limits = gimbal
        self.device = gimbal.component_id
        self.manager = manager
        self._send, self._telemetry = send, telemetry
        self._random = Random(seed)
        self._aim = _Aim()
        self._waiting: list[tuple[float, _Aim]] = []
        self.pitch_rad = 0.0
        self.yaw_rad = 0.0
        """Relative to the nose, right positive."""
        self._pitch_rate = self._yaw_rate = 0.0
        self._owner = (0, 0)
        self._word = "ok"
        self._next_s = {"heartbeat": 0.0, "attitude": 0.0, "status": 0.1}
        self._attitude_hz = _STATUS_HZ
        self._last_axis: tuple[float, float] | None = None
        self._commands: dict[int, Callable[[Command], Result]] = {
            511: self._set_interval,
            512: lambda c: self._request(c.whole(0)),
            1000: self._pitch_yaw,
            1001: self._configure,
        }

    def fault(self, word: str) -> None:
        """Change the failure word."""
        self._word = word

    def handle(self, message: Message) -> bool:
        """Act on a message; return whether it was the gimbal's."""
        if self._word == "off":
            return False
        name = message.get_type()
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if name == "GIMBAL_MANAGER_SET_ATTITUDE":
            if sender == self._owner:
                _, pitch, yaw = euler(tuple(getattr(message, "q")))  # noqa: B009 (untyped message)
                self._take(pitch, yaw, int(getattr(message, "flags", 0)))
            return True
        if name in ("GIMBAL_MANAGER_SET_PITCHYAW", "GIMBAL_MANAGER_SET_MANUAL_CONTROL"):
            if sender == self._owner:
                flags = int(getattr(message, "flags", 0))
                self._take(float(getattr(message, "pitch")), float(getattr(message, "yaw")), flags)  # noqa: B009 (untyped message)
            return True
        if name not in ("COMMAND_LONG", "COMMAND_INT"):
            return False
        command = command_of(message)
        action = self._commands.get(command.number)
        if action is None:
            return False
        if command.number == 512 and command.whole(0) not in (280, 281, 283, 285):
            return False
        if command.number == 511 and command.whole(0) != _ATTITUDE_STATUS:
            return False
        self._acknowledge(command, action(command))
        return True

    def refuse(self, message: Message) -> None:
        """Answer a command that the gimbal does not have."""
        if self._word != "off" and message.get_type() in ("COMMAND_LONG", "COMMAND_INT"):
            self._acknowledge(command_of(message), Result.UNSUPPORTED)

    def _acknowledge(self, command: Command, result: Result) -> None:
        ack = made("command_ack", command.number, result, 0, 0, command.system, command.component)
        self._send(ack, self.manager)

    # control

    def _configure(self, command: Command) -> Result:
        system, component = command.whole(0, -1), command.whole(1, -1)
        if system == -2 or component == -2:
            self._owner = (command.system, command.component)
        elif system == -3 or component == -3:
            self._owner = (0, 0)
        elif system >= 0 and component >= 0:
            self._owner = (system, component)
        self._next_s["status"] = -math.inf
        return Result.ACCEPTED

    def _pitch_yaw(self, command: Command) -> Result:
        if (command.system, command.component) != self._owner:
            return Result.DENIED
        pitch, yaw = command.params[0], command.params[1]
        self._take(math.radians(pitch), math.radians(yaw), command.whole(4))
        return Result.ACCEPTED

    def _take(self, pitch_rad: float, yaw_rad: float, flags: int) -> None:
        aim = _Aim(
            pitch_rad if math.isfinite(pitch_rad) else self._aim.pitch_rad,
            yaw_rad if math.isfinite(yaw_rad) else self._aim.yaw_rad,
            locked=bool(flags & (_YAW_LOCK | _EARTH_FRAME)),
        )
        if self._word in ("delayed", "slow"):
            self._waiting.append((self._telemetry.now_s + _DELAY_S, aim))
        elif self._word != "intermittent" or self._random.random() < 0.5:
            self._aim = aim

    # motion

    def step(self, dt_s: float) -> None:
        """Move towards the aim, and send what is due."""
        now_s = self._telemetry.now_s
        while self._waiting and self._waiting[0][0] <= now_s:
            self._aim = self._waiting.pop(0)[1]
        if self._word not in ("off", "stuck"):
            self._move(dt_s)
        if self._word != "off":
            self._stream(now_s)

    def _move(self, dt_s: float) -> None:
        limits, aim = self._limits, self._aim
        heading = euler(self._telemetry.ned_q)[2]
        yaw = math.remainder(aim.yaw_rad - (heading if aim.locked else 0.0), 2 * math.pi)
        most = math.radians(limits.max_yaw_deg)
        yaw = min(max(yaw, -most), most)
        pitch = min(
            max(aim.pitch_rad, math.radians(limits.min_pitch_deg)),
            math.radians(limits.max_pitch_deg),
        )
        if self._word == "wrong":
            pitch -= _WRONG_RAD
        rate_limit = math.radians(limits.max_rate_dps) * (0.1 if self._word == "slow" else 1.0)
        blend = 1 - math.exp(-dt_s / _RATE_LAG_S)
        for_pitch = min(max(_GAIN_PER_S * (pitch - self.pitch_rad), -rate_limit), rate_limit)
        for_yaw = min(max(_GAIN_PER_S * (yaw - self.yaw_rad), -rate_limit), rate_limit)
        self._pitch_rate += blend * (for_pitch - self._pitch_rate)
        self._yaw_rate += blend * (for_yaw - self._yaw_rate)
        self.pitch_rad += self._pitch_rate * dt_s
        self.yaw_rad += self._yaw_rate * dt_s

    def truth(self, body_yaw_rad: float, dt_s: float) -> GimbalTruth:
        """Return the optical frame in the world (ENU) for the body's true yaw."""
        yaw = body_yaw_rad - self.yaw_rad + self._random.gauss(0.0, _JITTER_RAD)
        pitch = self.pitch_rad + self._random.gauss(0.0, _JITTER_RAD)
        rate = 0.0
        if self._last_axis is not None:
            turned = math.remainder(body_yaw_rad - self.yaw_rad - self._last_axis[0], 2 * math.pi)
            across = turned * math.cos(self.pitch_rad)
            rate = math.hypot(across, self.pitch_rad - self._last_axis[1]) / dt_s
        self._last_axis = (body_yaw_rad - self.yaw_rad, self.pitch_rad)
        # FLU: a positive pitch looks down, so up is negative.
        return GimbalTruth(product(quaternion_from_euler(0.0, -pitch, yaw), _OPTICAL), rate)

    # telemetry

    def _stream(self, now_s: float) -> None:
        if now_s >= self._next_s["heartbeat"]:
            self._next_s["heartbeat"] = now_s + 1.0
            self._send(made("heartbeat", 26, 8, 0, 0, 4, 3), self.device)
        if now_s >= self._next_s["status"]:
            self._next_s["status"] = now_s + 1.0
            self._send(self._manager_status(), self.manager)
        if now_s >= self._next_s["attitude"] - 1e-6:
            next_s = self._next_s["attitude"] + 1 / self._attitude_hz
            self._next_s["attitude"] = max(next_s, now_s - 0.02)
            self._send(self._attitude_status(), self.device)

    def _set_interval(self, command: Command) -> Result:
        """Honour SET_MESSAGE_INTERVAL of the attitude: 0 takes the default."""
        interval_us = command.params[1]
        if not math.isfinite(interval_us) or interval_us < 0:
            return Result.DENIED
        self._attitude_hz = min(1e6 / interval_us, _STATUS_HZ) if interval_us else _STATUS_HZ
        self._next_s["attitude"] = -math.inf
        return Result.ACCEPTED

    def _request(self, number: int) -> Result:
        builders = {
            280: (self._manager_information, self.manager),
            281: (self._manager_status, self.manager),
            283: (self._device_information, self.device),
            285: (self._attitude_status, self.device),
        }
        builder, component = builders[number]
        self._send(builder(), component)
        return Result.ACCEPTED

    def _ranges(self) -> tuple[float, float, float, float, float, float]:
        limits = self._limits
        yaw = math.radians(limits.max_yaw_deg)
        lowest, highest = math.radians(limits.min_pitch_deg), math.radians(limits.max_pitch_deg)
        return (0.0, 0.0, lowest, highest, -yaw, yaw)

    def _manager_information(self) -> Message:
        # Retract and neutral; pitch and yaw axes; pitch and yaw follow and lock.
        capabilities = 0x1 | 0x2 | 0x20 | 0x40 | 0x80 | 0x100 | 0x200 | 0x400
        return made(
            "gimbal_manager_information",
            self._telemetry.ms,
            capabilities,
            self.device,
            *self._ranges(),
        )

    def _device_information(self) -> Message:
        name = b"synthetic"
        return made(
            "gimbal_device_information",
            self._telemetry.ms,
            b"bladescout",
            name,
            name,
            1 << 24,
            1 << 24,
            1,
            0x1 | 0x2 | 0x20 | 0x40 | 0x80 | 0x100 | 0x200 | 0x400,
            0,
            *self._ranges(),
        )

    def _flags(self) -> int:
        yaw = _YAW_LOCK | _EARTH_FRAME if self._aim.locked else _VEHICLE_FRAME
        return 4 | 8 | yaw

    def _manager_status(self) -> Message:
        return made(
            "gimbal_manager_status",
            self._telemetry.ms,
            self._flags(),
            self.device,
            *self._owner,
            0,
            0,
        )

    def _attitude_status(self) -> Message:
        heading = euler(self._telemetry.ned_q)[2]
        yaw = self.yaw_rad + (heading if self._aim.locked else 0.0)
        pitch = self.pitch_rad
        if self._word == "garbage":
            pitch, yaw = self._random.uniform(-3.1, 3.1), self._random.uniform(-3.1, 3.1)
        q = quaternion_from_euler(0.0, pitch, yaw)
        return made(
            "gimbal_device_attitude_status",
            0,
            0,
            self._telemetry.ms,
            self._flags(),
            list(q),
            0.0,
            self._pitch_rate,
            self._yaw_rate,
            0,
            heading,
            -self._telemetry.rates_b[2],
            0,
        )
