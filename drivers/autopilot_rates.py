"""How often the autopilot tells what: often in flight, seldom while nothing flies.

Every message costs us a fifth of a millisecond of CPU time, whether anybody wants it or not: at
rest the busy streams that are none of ours are slowed, too, and then given back to the vehicle's
own settings. A vehicle that does not offer a stream says so, and is taken as it is.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from drivers.autopilot_errors import AutopilotError, LinkFailed, Refused, Unanswered
from drivers.autopilot_wire import Wire

_log = logging.getLogger(__name__)

_SET_MESSAGE_INTERVAL, _REQUEST_MESSAGE = 511, 512
_HEARTBEAT, _CURRENT_MODE = 0, 436
_ATTITUDE_QUATERNION, _LOCAL_POSITION, _GLOBAL_POSITION = 31, 32, 33
_ODOMETRY, _WIND, _HOME = 331, 231, 242
#: ATTITUDE, SERVO_OUTPUT_RAW, VFR_HUD, ATTITUDE_TARGET, POSITION_TARGET_LOCAL_NED and _GLOBAL_INT,
#: HIGHRES_IMU, ALTITUDE: what PX4 sends unasked, some of it a hundred times a second.
_NOT_OURS = (30, 36, 74, 83, 85, 87, 105, 141)
_ITS_OWN_RATE = 0.0
_MODE_HZ = 10.0
#: Disarmed, between missions: whoever arms the vehicle is seen by its heartbeat, at 1 Hz.
REST_HZ = 2.0
_REST_MODE_HZ = 1.0
_LOOK_S = 0.25
#: Asked so often where nothing is answered; then what comes is all that there is.
_ROUNDS = 3


class MessageRates:
    """Asks for the streams: at the start, at each change, and after a silence (a reboot forgets).

    ``connected``: whether the autopilot is heard; ``position_hz``: what is wanted in flight.
    """

    def __init__(self, wire: Wire, connected: Callable[[], bool], position_hz: float) -> None:
        self._wire = wire
        self._connected = connected
        self._flying = {
            _LOCAL_POSITION: position_hz,
            _ATTITUDE_QUATERNION: position_hz,
            _ODOMETRY: 5.0,
            _GLOBAL_POSITION: 5.0,
            _WIND: 1.0,
            _HOME: 0.5,
        }
        self._slowed = False
        self._told: bool | None = None
        """What the vehicle was last asked for: as at rest, or everything."""
        self._changed = asyncio.Event()
        self._resting = False

    @property
    def awake(self) -> bool:
        """The vehicle has answered for everything that a flight needs (or never answers)."""
        return self._told is False and not self._resting

    def rest(self, resting: bool) -> None:
        """Set whether little is enough; at first everything is wanted. On the event loop."""
        if resting != self._resting:
            self._resting = resting
            self._changed.set()

    async def keep(self) -> None:
        """Keep the streams as they are wanted, until cancelled."""
        rounds = 0
        while True:
            if not self._connected():
                self._told = None
            elif self._told != self._resting:
                wanted = self._resting
                rounds += 1
                if await self._ask(resting=wanted) or rounds >= _ROUNDS:
                    self._told, rounds = wanted, 0
            try:
                async with asyncio.timeout(_LOOK_S):
                    await self._changed.wait()
                self._changed.clear()
                rounds = 0
            except TimeoutError:
                continue

    async def _ask(self, *, resting: bool) -> bool:
        """Ask for everything; return whether all of it was answered, by yes or by no."""
        answered = True
        for message, rate_hz in self._flying.items():
            try:
                await self._stream(message, min(rate_hz, REST_HZ) if resting else rate_hz)
            except Unanswered as error:
                _log.debug("%s", error)
                answered = False
            except Refused as error:
                _log.debug("%s", error)
                if message == _HOME:
                    await self._request(message)
            except LinkFailed as error:
                _log.debug("%s", error)
                return False
        answered &= await self._ask_mode(_REST_MODE_HZ if resting else _MODE_HZ)
        if answered and self._slowed != resting:
            await self._ask_others(resting=resting)
        return answered

    async def _ask_others(self, *, resting: bool) -> None:
        """Slow what is not ours, or give it back; nothing of a flight hangs on it."""
        for message in _NOT_OURS:
            try:
                await self._stream(message, REST_HZ if resting else _ITS_OWN_RATE)
            except AutopilotError as error:
                _log.debug("%s", error)
        self._slowed = resting

    async def _ask_mode(self, rate_hz: float) -> bool:
        """Ask for the mode by its own message or, of a vehicle without it, by the heartbeat."""
        answered = True
        for message in (_CURRENT_MODE, _HEARTBEAT):
            try:
                await self._stream(message, rate_hz)
            except Unanswered:
                answered = False
            except AutopilotError as error:
                _log.debug("%s", error)
            else:
                break
        return answered

    async def _request(self, message: int) -> None:
        """Ask for a message once, of a vehicle that does not stream it."""
        try:
            await self._wire.command(
                f"message {message}", _REQUEST_MESSAGE, (float(message),), tries=1
            )
        except AutopilotError as error:
            _log.debug("%s", error)

    async def _stream(self, message: int, rate_hz: float) -> None:
        """Ask for one stream; 0 is the rate that the vehicle itself has for it."""
        await self._wire.command(
            f"message {message} at {rate_hz:g} Hz",
            _SET_MESSAGE_INTERVAL,
            (float(message), 1e6 / rate_hz if rate_hz else 0.0),
            tries=1,
        )
