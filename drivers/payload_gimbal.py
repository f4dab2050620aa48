"""A MAVLink gimbal (protocol v2), aimed by absolute ENU angles.

The gimbal manager is found by its information message, on the autopilot (PX4) or on the payload
itself. Aims are unacknowledged messages, so that they can leave from the tick; control is taken
by command, and taken again when nobody has it; a person who took it keeps it.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from config.sensors import Gimbal
from drivers.autopilot_errors import LinkFailed, Refused, Unanswered
from drivers.autopilot_wire import OWN_COMPONENT, Received, Wire
from drivers.clock import Clock
from drivers.frames import pitch_up_of, swap_attitude, swap_yaw, yaw_of
from drivers.stamps import MinimumOffset
from perception.geometry import wrap_angle

_log = logging.getLogger(__name__)

_MANAGER_INFORMATION, _MANAGER_STATUS, _DEVICE_ATTITUDE = 280, 281, 285
_SET_MESSAGE_INTERVAL, _REQUEST_MESSAGE, _CONFIGURE = 511, 512, 1001
_LOCK_ROLL_PITCH_YAW = 4 | 8 | 16
_YAW_LOCK, _YAW_IN_VEHICLE_FRAME, _YAW_IN_EARTH_FRAME = 16, 32, 64
_ATTITUDE_RATE_HZ = 30.0
#: While nothing flies; a second of silence counts as a gimbal that is gone.
_REST_RATE_HZ = 2.0
_UNCHANGED = -1.0
_AUTOPILOT = 1
#: Device ids of gimbals behind a manager that speak no MAVLink; others are components.
_WITHOUT_MAVLINK = range(1, 7)
_NOBODY = (0, 0)


@dataclass(frozen=True, slots=True)
class GimbalReading:
    """Where the gimbal looks; the field names are those of the mission's `GimbalState`."""

    stamp_s: float
    """By the gimbal's own time stamp."""
    yaw_rad: float
    """ENU, absolute."""
    pitch_rad: float
    """Positive up."""
    in_control: bool = False
    """The gimbal manager says that we are its primary control."""


class GimbalLink:
    """One gimbal device and its manager.

    ``vehicle_yaw``: the vehicle's present ENU yaw, for gimbals that report relative to the nose.
    """

    def __init__(
        self,
        wire: Wire,
        settings: Gimbal,
        clock: Clock,
        vehicle_yaw: Callable[[], float | None],
    ) -> None:
        self._wire = wire
        self._settings = settings
        self._clock = clock
        self._vehicle_yaw = vehicle_yaw
        self._manager: int | None = None
        self._rank = 0
        self._device = settings.component_id
        self._ourselves = (wire.system_id, OWN_COMPONENT)
        self._owner: tuple[int, int] | None = None
        self._reading: GimbalReading | None = None
        self._stamps = MinimumOffset(window_s=5.0)
        self._rate_hz = _ATTITUDE_RATE_HZ
        self._changed = asyncio.Event()
        wire.listen("GIMBAL_MANAGER_INFORMATION", self._take_information)
        wire.listen("GIMBAL_MANAGER_STATUS", self._take_status)
        wire.listen("GIMBAL_DEVICE_ATTITUDE_STATUS", self._take_attitude)

    @property
    def ready(self) -> bool:
        """A gimbal manager was found."""
        return self._manager is not None

    def reading(self) -> GimbalReading | None:
        """Return the newest attitude; None before the first."""
        if self._reading is None:
            return None
        return replace(self._reading, in_control=self._in_control)

    @property
    def _in_control(self) -> bool:
        return self._owner == self._ourselves

    def aim(self, yaw_rad: float, pitch_rad: float) -> bool:
        """Point the optical axis to ENU yaw and pitch, now, on this thread.

        Returns False where no gimbal was found yet. Pitch is kept within the configured limits.
        """
        if self._manager is None:
            return False
        if not (math.isfinite(yaw_rad) and math.isfinite(pitch_rad)):
            raise ValueError(f"gimbal aim not finite: {yaw_rad} {pitch_rad}")
        low = math.radians(self._settings.min_pitch_deg)
        high = math.radians(self._settings.max_pitch_deg)
        fields = {
            "target_system": self._wire.system_id,
            "target_component": self._manager,
            "flags": _LOCK_ROLL_PITCH_YAW,
            "gimbal_device_id": self._device,
            "pitch": max(low, min(high, pitch_rad)),
            "yaw": swap_yaw(yaw_rad),
            "pitch_rate": None,
            "yaw_rate": None,
        }
        self._wire.send("GIMBAL_MANAGER_SET_PITCHYAW", json.dumps(fields), self._manager)
        return True

    def rest(self, resting: bool) -> None:
        """Let the gimbal tell seldom where it looks; at first often. On the event loop."""
        rate_hz = _REST_RATE_HZ if resting else _ATTITUDE_RATE_HZ
        if rate_hz != self._rate_hz:
            self._rate_hz = rate_hz
            self._changed.set()

    async def run(self) -> None:
        """Find the manager, take control, and keep both."""
        asked_hz: float | None = None
        while True:
            self._changed.clear()
            try:
                if self._manager is None:
                    await self._look_for_manager()
                if self._manager is not None and asked_hz != self._rate_hz:
                    asked_hz = await self._ask_rate(self._rate_hz)
                if self._manager is not None and self._owner in (None, _NOBODY):
                    await self._take_control(self._manager)
            except (Refused, LinkFailed) as error:
                _log.debug("gimbal: %s", error)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(0.1 if self._manager is None else 1.0):
                    await self._changed.wait()

    async def _look_for_manager(self) -> None:
        await asyncio.gather(
            *(
                self._wire.command(
                    "gimbal manager information",
                    _REQUEST_MESSAGE,
                    (float(_MANAGER_INFORMATION),),
                    component,
                    tries=1,
                )
                for component in (self._settings.component_id, _AUTOPILOT)
            ),
            return_exceptions=True,
        )

    async def _take_control(self, manager: int) -> None:
        await self._wire.command(
            "gimbal control",
            _CONFIGURE,
            (
                float(self._wire.system_id),
                float(OWN_COMPONENT),
                _UNCHANGED,
                _UNCHANGED,
                None,
                None,
                float(self._device),
            ),
            manager,
        )
        self._owner = self._ourselves

    async def _ask_rate(self, rate_hz: float) -> float | None:
        """Ask how often to be told; return what was asked for, None where nothing answered."""
        behind = self._device in _WITHOUT_MAVLINK
        try:
            await self._wire.command(
                f"message {_DEVICE_ATTITUDE} at {rate_hz:g} Hz",
                _SET_MESSAGE_INTERVAL,
                (float(_DEVICE_ATTITUDE), 1e6 / rate_hz),
                (self._manager if behind else None) or self._settings.component_id,
                tries=1,
            )
        except Unanswered:
            return None
        except Refused as error:
            _log.debug("gimbal: %s", error)
        return rate_hz

    def _take_information(self, message: Received) -> None:
        device, own = message.integer("gimbal_device_id"), self._settings.component_id
        # Ours by name comes before one that an autopilot has besides, whoever answers last.
        rank = 1 + (device == own) + 2 * (message.component_id == own)
        if rank > self._rank and (device in (0, own) or device in _WITHOUT_MAVLINK):
            self._device, self._manager, self._rank = device, message.component_id, rank

    def _take_status(self, message: Received) -> None:
        if message.component_id != self._manager:
            return
        self._owner = (
            message.integer("primary_control_sysid"),
            message.integer("primary_control_compid"),
        )

    def _is_ours(self, message: Received) -> bool:
        """Return whether it is the gimbal's own, or its manager speaks for it."""
        if message.component_id == self._settings.component_id:
            return True
        told = message.component_id == self._manager and self._device in _WITHOUT_MAVLINK
        return told and message.integer("gimbal_device_id", self._device) == self._device

    def _take_attitude(self, message: Received) -> None:
        if not self._is_ours(message):
            return
        q = message.numbers("q")
        if len(q) != 4 or not 0.9 < math.hypot(*q) < 1.1:
            return
        flags = message.integer("flags")
        attitude = swap_attitude((q[0], q[1], q[2], q[3]))
        yaw_rad = yaw_of(attitude)
        absolute = flags & _YAW_IN_EARTH_FRAME or (
            flags & _YAW_LOCK and not flags & _YAW_IN_VEHICLE_FRAME
        )
        if not absolute:
            vehicle_yaw_rad = self._vehicle_yaw()
            if vehicle_yaw_rad is None:
                return
            # Relative to the nose, in the manner of a heading; north of that frame is the nose.
            yaw_rad = wrap_angle(yaw_rad - math.pi / 2 + vehicle_yaw_rad)
        stamp_s = self._stamps.map(
            message.number("time_boot_ms") * 1e-3,
            self._clock.mission_time_of(message.arrival_ns),
        )
        self._reading = GimbalReading(stamp_s, yaw_rad, pitch_up_of(attitude))
