"""The vehicle: what it reports, setpoints from the control tick, and acknowledged commands.

::

    async with AutopilotLink(settings.autopilot, clock) as link:
        reading = link.vehicle()
        link.send_setpoint(position_w, velocity_w, yaw_rad)  # from the tick, synchronously
        await link.act("hold")

Setpoints leave on the caller's thread and nowhere else: MAVSDK's own offboard thread would go on
re-sending the last one after this process has stalled, and is never started.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import Self

from config.links import Autopilot
from drivers.autopilot_errors import BadSetpoint, Refused
from drivers.autopilot_parameters import Parameters
from drivers.autopilot_rates import MessageRates
from drivers.autopilot_state import VehicleMode, VehicleReading, VehicleState
from drivers.autopilot_wire import Wire
from drivers.clock import Clock
from drivers.frames import Vec3, swap_enu_ned, swap_yaw

#: Position, velocity and yaw are set; acceleration and yaw rate are not.
_POSITION_VELOCITY_YAW = 0x9C0
_FRAME_LOCAL_NED = 1

_ARM_DISARM, _TAKEOFF, _SET_MODE = 400, 22, 176
_CUSTOM_MODE = 1.0
_MODES: dict[str, tuple[float, ...]] = {
    "offboard": (_CUSTOM_MODE, 6.0, 0.0),
    "hold": (_CUSTOM_MODE, 4.0, 3.0),
    "return": (_CUSTOM_MODE, 4.0, 5.0),
    "land": (_CUSTOM_MODE, 4.0, 6.0),
}

#: Wall seconds without a heartbeat (1 Hz by the protocol) after which the link counts as lost.
_SILENT_S = 3.5
#: A vehicle that sends its attitude by quaternion has done so within so many seconds.
_QUATERNION_WITHIN_S = 2.0
#: The autopilot's reason follows its refusal.
_REASON_S = 0.1


class AutopilotLink:
    """One autopilot by MAVLink, bound to one system id; an async context manager."""

    def __init__(self, settings: Autopilot, clock: Clock, tap_file: Path | None = None) -> None:
        """``tap_file``: where to tell on which port the raw link can be heard; None: nowhere."""
        self._settings = settings
        self._clock = clock
        self._tap_file = tap_file if settings.record_link else None
        self._state = VehicleState(clock)
        self._wire: Wire | None = None
        self._parameters: Parameters | None = None
        self._rates: MessageRates | None = None
        self._keeping: asyncio.Future[tuple[None, None]] | None = None
        self.setpoints_sent = 0
        """Setpoints sent since the link was opened."""

    async def __aenter__(self) -> Self:
        """Connect; raises `PortTaken`, `LinkFailed` or `NoVehicle`."""
        urls = [self._settings.url]
        if self._settings.payload_url:
            urls.append(self._settings.payload_url)
        self._wire = await Wire.open(
            urls, self._settings.system_id, self._settings.connect_timeout_s, self._tap_file
        )
        for name in VehicleState.MESSAGES:
            self._wire.listen(name, self._state.take, component_id=1)
        self._parameters = Parameters(self._wire)
        self._rates = MessageRates(
            self._wire, lambda: self.connected, self._settings.position_rate_hz
        )
        self._keeping = asyncio.gather(self._rates.keep(), self._take_angles_for_quaternions())
        return self

    async def __aexit__(self, *_: object) -> None:
        """Let go of the vehicle; nothing is sent any more."""
        if self._keeping is not None:
            self._keeping.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._keeping
        if self._wire is not None:
            await self._wire.close()

    @property
    def wire(self) -> Wire:
        """The messages of this system, for the payload."""
        if self._wire is None:
            raise RuntimeError("the link is not open")
        return self._wire

    @property
    def connected(self) -> bool:
        """The autopilot's heartbeats arrive."""
        silent_s = self._clock.now_s() - self._state.heartbeat_stamp_s
        return silent_s <= _SILENT_S * max(1.0, self._clock.factor())

    def vehicle(self) -> VehicleReading | None:
        """Return the newest of everything that the vehicle reported."""
        return self._state.reading()

    def rest(self, resting: bool) -> None:
        """Let the vehicle tell little, while nothing flies; at first everything is wanted."""
        if self._rates is not None:
            self._rates.rest(resting)

    @property
    def awake(self) -> bool:
        """The vehicle was asked for everything that a flight needs, and has answered."""
        return self._rates is not None and self._rates.awake

    async def _take_angles_for_quaternions(self) -> None:
        """Hear the attitude as angles where, for a while, no quaternion came."""
        await asyncio.sleep(_QUATERNION_WITHIN_S)
        if not self._state.has_quaternion:
            self.wire.listen(VehicleState.EULER_ATTITUDE, self._state.take, component_id=1)

    def send_setpoint(self, position_w: Vec3, velocity_w: Vec3, yaw_rad: float) -> None:
        """Send position, velocity fed forward and yaw (ENU) now, on this thread.

        Raises `BadSetpoint` where a number is not finite, `LinkFailed` where nothing can be sent.
        """
        if not all(map(math.isfinite, (*position_w, *velocity_w, yaw_rad))):
            raise BadSetpoint(f"setpoint not finite: {position_w} {velocity_w} {yaw_rad}")
        x, y, z = swap_enu_ned(position_w)
        vx, vy, vz = swap_enu_ned(velocity_w)
        stamp_ms = int(self._clock.now_s() * 1e3) & 0xFFFFFFFF
        self.wire.send(
            "SET_POSITION_TARGET_LOCAL_NED",
            f'{{"time_boot_ms":{stamp_ms},"target_system":{self.wire.system_id},'
            f'"target_component":1,"coordinate_frame":{_FRAME_LOCAL_NED},'
            f'"type_mask":{_POSITION_VELOCITY_YAW},"x":{float(x)!r},"y":{float(y)!r},'
            f'"z":{float(z)!r},"vx":{float(vx)!r},"vy":{float(vy)!r},"vz":{float(vz)!r},'
            f'"afx":0.0,"afy":0.0,"afz":0.0,"yaw":{swap_yaw(yaw_rad)!r},"yaw_rate":0.0}}',
        )
        self.setpoints_sent += 1

    async def act(self, action: str, height_m: float = 0.0) -> None:
        """Carry out arm, disarm, takeoff, offboard, hold, return or land.

        ``height_m``: above the present height, for takeoff. At most three tries, and none after
        the pilot has taken over; raises `Refused` with the autopilot's own words where it gave
        any.
        """
        started = self._clock.now_s()
        mode_before = self._state.mode

        def wanted() -> bool:
            return self._state.mode is mode_before or self._state.mode is not VehicleMode.PILOT

        try:
            if action in ("arm", "disarm"):
                await self.wire.command(
                    action, _ARM_DISARM, (float(action == "arm"),), wanted=wanted
                )
            elif action == "takeoff":
                await self._take_off(height_m, wanted)
            elif action in _MODES:
                await self.wire.command(action, _SET_MODE, _MODES[action], wanted=wanted)
            else:
                raise ValueError(f"unknown action {action!r}")
        except Refused as error:
            await asyncio.sleep(_REASON_S)
            words = dict.fromkeys(
                t.text for t in self._state.texts() if t.stamp_s >= started and t.severity <= 4
            )
            if words:
                raise Refused(f"{error}: {'; '.join(words)}") from error
            raise

    async def _take_off(self, height_m: float, wanted: Callable[[], bool]) -> None:
        altitude_m = self._state.altitude_m
        if altitude_m is None and self._settings.strict:
            raise Refused("takeoff: the vehicle's altitude is not known yet")
        # Height above sea level; where and with which heading stays the autopilot's own choice, and
        # how high, where it tells no altitude.
        top_m = None if altitude_m is None else altitude_m + height_m
        where = (0.0, 0.0, 0.0, None, None, None, top_m)
        await self.wire.command("takeoff", _TAKEOFF, where, wanted=wanted)

    async def read_parameters(self, names: tuple[str, ...]) -> dict[str, float]:
        """Return the values of the named parameters; those that the vehicle lacks are left out."""
        if self._parameters is None:
            raise RuntimeError("the link is not open")
        return await self._parameters.read(names)

    async def set_parameter(self, name: str, value: float) -> None:
        """Set one parameter; raises `Refused`."""
        if self._parameters is None:
            raise RuntimeError("the link is not open")
        await self._parameters.set(name, value)
