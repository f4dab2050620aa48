"""The mock autopilot on the wire: a PX4-like component that answers what MAVSDK 4.1 asks.

Commands are always acknowledged, UNSUPPORTED where PX4 has none such; messages for another system
are ignored. NaN is legal in unused parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from drivers.simulated.guidance import Guidance
from drivers.simulated.mavlink_services import FenceStore, refuse_file_transfer
from drivers.simulated.mavlink_streams import BUILDERS, Streams, Telemetry
from drivers.simulated.mavlink_wire import MavlinkLink, Message, Received, made
from drivers.simulated.ned import swapped, turned
from drivers.simulated.position_control import Target
from drivers.simulated.px4_modes import Commander, Mode, Result, mode_from_custom
from drivers.simulated.px4_parameters import Parameter, Parameters
from drivers.simulated.vehicle import Vec3

COMPONENT = 1
_FORCE = 21196
_LOCAL_NED = 1
_NAN = math.nan


@dataclass(frozen=True, slots=True)
class Command:
    """COMMAND_LONG or COMMAND_INT in one shape."""

    number: int
    params: tuple[float, float, float, float, float, float, float]
    system: int
    component: int

    def whole(self, index: int, fallback: int = 0) -> int:
        """Return a parameter as an integer; NaN is 'not given'."""
        value = self.params[index]
        return int(value) if math.isfinite(value) else fallback


def command_of(message: Message) -> Command:
    """Read a COMMAND_LONG or COMMAND_INT."""
    names = ("param5", "param6", "param7")
    if message.get_type() == "COMMAND_INT":
        names = ("x", "y", "z")
    params = [float(getattr(message, f"param{i}")) for i in range(1, 5)]
    params += [float(getattr(message, name)) for name in names]
    return Command(
        int(getattr(message, "command")),  # noqa: B009 (untyped message)
        (params[0], params[1], params[2], params[3], params[4], params[5], params[6]),
        message.get_srcSystem(),
        message.get_srcComponent(),
    )


class MockAutopilot:
    """PX4-like component 1 of the vehicle."""

    def __init__(
        self,
        link: MavlinkLink,
        system: int,
        parameters: Parameters,
        commander: Commander,
        guidance: Guidance,
        telemetry: Telemetry,
    ) -> None:
        self._link, self._system = link, system
        self._parameters, self._commander = parameters, commander
        self._guidance, self._telemetry = guidance, telemetry
        self._streams = Streams()
        self._fence = FenceStore()
        self._told: tuple[int, bool, int] | None = None
        self._listing: list[str] = []
        self._commands: dict[int, Callable[[Command], Result]] = {
            400: self._arm_disarm,
            22: self._take_off,
            21: lambda _: self._mode(Mode.LAND),
            20: lambda _: self._mode(Mode.RETURN),
            176: self._do_set_mode,
            410: lambda _: self._request(242),
            510: self._get_interval,
            511: self._set_interval,
            512: lambda c: self._request(c.whole(0)),
            519: lambda _: self._request(148),
            520: lambda _: self._request(148),
        }
        self._handlers: dict[str, Callable[[Message], None]] = {
            "COMMAND_LONG": self._command,
            "COMMAND_INT": self._command,
            "SET_POSITION_TARGET_LOCAL_NED": self._setpoint,
            "SET_MODE": self._old_set_mode,
            "PARAM_REQUEST_READ": self._param_read,
            "PARAM_REQUEST_LIST": self._param_list,
            "PARAM_SET": self._param_set,
            "PING": self._ping,
            "TIMESYNC": self._timesync,
            "FILE_TRANSFER_PROTOCOL": lambda m: self._send(refuse_file_transfer(m)),
        }

    def is_for_us(self, message: Message) -> bool:
        """Return whether a message is addressed to this component, or to all."""
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, self._system) and component in (0, COMPONENT)

    def handle(self, received: Received) -> None:
        """Act on one message."""
        message = received.message
        if not self.is_for_us(message):
            return
        handler = self._handlers.get(message.get_type())
        if handler is not None:
            handler(message)
        elif message.get_type().startswith("MISSION_"):
            for reply in self._fence.handle(message):
                self._send(reply)

    def step(self) -> None:
        """Send what is due: changes of state at once, streams at their rates, texts."""
        t = self._telemetry
        told = (t.custom_mode, t.armed, t.landed_state)
        if self._told is not None and told[:2] != self._told[:2]:
            self._streams.bring_forward(0)
        self._told = told
        for message in self._streams.due(t):
            self._send(message)
        for severity, text in self._commander.texts:
            self._send(made("statustext", severity, text.encode()[:50], 0, 0))
        self._commander.texts.clear()
        for name in self._listing[:8]:
            self._send_parameter(self._parameters.get(name))
        del self._listing[:8]

    def _send(self, message: Message) -> None:
        self._link.send(message, self._system, COMPONENT, self._telemetry.now_s)

    # commands

    def _command(self, message: Message) -> None:
        command = command_of(message)
        action = self._commands.get(command.number)
        result = action(command) if action is not None else Result.UNSUPPORTED
        self._send(
            made("command_ack", command.number, result, 0, 0, command.system, command.component)
        )

    def _mode(self, mode: Mode) -> Result:
        return self._commander.set_mode(mode, self._telemetry.now_s)

    def _arm_disarm(self, command: Command) -> Result:
        now_s, force = self._telemetry.now_s, command.whole(1) == _FORCE
        if command.whole(0) == 1:
            return self._commander.arm(now_s, force=force)
        return self._commander.disarm(now_s, force=force)

    def _take_off(self, command: Command) -> Result:
        height_m = command.params[6] - self._telemetry.home.altitude_m
        return self._commander.take_off(height_m, self._telemetry.now_s)

    def _do_set_mode(self, command: Command) -> Result:
        if not command.whole(0) & 1:
            return Result.DENIED
        mode = mode_from_custom(command.whole(1), command.whole(2))
        return self._mode(mode) if mode is not None else Result.DENIED

    def _old_set_mode(self, message: Message) -> None:
        custom = int(getattr(message, "custom_mode", 0))
        mode = mode_from_custom(custom >> 16 & 0xFF, custom >> 24 & 0xFF)
        if mode is not None:
            self._mode(mode)

    def _request(self, number: int) -> Result:
        builder = BUILDERS.get(number)
        if builder is None:
            return Result.UNSUPPORTED
        message = builder(self._telemetry)
        if message is None:
            return Result.TEMPORARILY_REJECTED
        self._send(message)
        return Result.ACCEPTED

    def _get_interval(self, command: Command) -> Result:
        number = command.whole(0)
        interval_us = self._streams.interval_us(number)
        self._send(made("message_interval", number, interval_us))
        return Result.ACCEPTED

    def _set_interval(self, command: Command) -> Result:
        done = self._streams.set_interval(
            command.whole(0), command.params[1], self._telemetry.now_s
        )
        return Result.ACCEPTED if done else Result.UNSUPPORTED

    # set-points

    def _setpoint(self, message: Message) -> None:
        target = target_of(message)
        if target is None:
            return
        self._guidance.offboard = target
        self._commander.setpoint_received(self._telemetry.now_s)

    # parameters

    def _param_read(self, message: Message) -> None:
        index = int(getattr(message, "param_index", -1))
        if index >= 0:
            self._send_parameter(self._parameters.at(index))
        else:
            self._send_parameter(self._parameters.get(str(getattr(message, "param_id", ""))))

    def _param_list(self, _: Message) -> None:
        self._listing = list(self._parameters.names)

    def _param_set(self, message: Message) -> None:
        name = str(getattr(message, "param_id", ""))
        value = float(getattr(message, "param_value", _NAN))
        self._parameters.set_from_wire(name, value, int(getattr(message, "param_type", 0)))
        self._send_parameter(self._parameters.get(name))

    def _send_parameter(self, parameter: Parameter | None) -> None:
        if parameter is None:
            return
        self._send(
            made(
                "param_value",
                parameter.name.encode(),
                parameter.wire_value(),
                parameter.kind,
                len(self._parameters),
                self._parameters.index_of(parameter.name),
            )
        )

    # small services

    def _ping(self, message: Message) -> None:
        if getattr(message, "target_system", 0) != 0:
            return
        self._send(
            made(
                "ping",
                getattr(message, "time_usec", 0),
                getattr(message, "seq", 0),
                message.get_srcSystem(),
                message.get_srcComponent(),
            )
        )

    def _timesync(self, message: Message) -> None:
        if getattr(message, "tc1", 1) == 0:
            now_ns = int(self._telemetry.now_s * 1e9)
            self._send(made("timesync", now_ns, getattr(message, "ts1", 0)))


def target_of(message: Message) -> Target | None:
    """Read SET_POSITION_TARGET_LOCAL_NED; None where PX4 would not fly it."""
    if getattr(message, "coordinate_frame", 0) != _LOCAL_NED:
        return None
    mask = int(getattr(message, "type_mask", 0))

    def vector(names: tuple[str, str, str], first_bit: int) -> Vec3:
        ned = [
            _NAN if mask >> (first_bit + i) & 1 else float(getattr(message, name))
            for i, name in enumerate(names)
        ]
        return swapped((ned[0], ned[1], ned[2]))

    position = vector(("x", "y", "z"), 0)
    velocity = vector(("vx", "vy", "vz"), 3)
    acceleration = vector(("afx", "afy", "afz"), 6)
    # PX4 flies an axis only where position, velocity or acceleration is given for it.
    for axis in zip(position, velocity, acceleration, strict=True):
        if all(math.isnan(value) for value in axis):
            return None
    if any(math.isinf(value) for value in (*position, *velocity, *acceleration)):
        return None
    yaw = _NAN if mask & 0x400 else float(getattr(message, "yaw", _NAN))
    rate = _NAN if mask & 0x800 else -float(getattr(message, "yaw_rate", _NAN))
    forward = (
        0.0 if math.isnan(acceleration[0]) else acceleration[0],
        0.0 if math.isnan(acceleration[1]) else acceleration[1],
        0.0 if math.isnan(acceleration[2]) else acceleration[2],
    )
    return Target(position, velocity, forward, turned(yaw) if math.isfinite(yaw) else _NAN, rate)
