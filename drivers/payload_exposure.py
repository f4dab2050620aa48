"""Exposure of a MAVLink camera through its extended parameters.

`CAM_EV` is the exposure value; `CAM_EXPMODE` (0 automatic, 1 manual) says whether it is absolute
or biases an automatic exposure: manual is chosen where the camera has it. `CAM_SHUTTER` is asked
to be as short as the flight wishes, where the camera lets it be set: a quick shutter and a higher
ISO blur less. A camera without `CAM_EV` has no EV control, and says so by None. What the camera
applied is read back, because cameras clamp and round: the report is theirs, never the wish.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import Callable

from drivers.autopilot_errors import LinkFailed, Refused
from drivers.autopilot_parameters import Parameters
from drivers.autopilot_wire import Wire
from drivers.clock import Clock

_log = logging.getLogger(__name__)

_EV, _MODE, _SHUTTER = "CAM_EV", "CAM_EXPMODE", "CAM_SHUTTER"
_EV_MIN, _EV_MAX, _EV_STEP = "CAM_EV_MIN", "CAM_EV_MAX", "CAM_EV_STEP"
_MANUAL = 1.0
_RETRY_S = 2.0
_LOOK_S = 0.2
_SILENCES = 3
_SAME_EV = 0.02


class ExposureControl:
    """Applies the newest EV asked for; wishes that were overtaken are never sent.

    ``step_ev``: the steps to snap to, within -3 to +3, unless the camera tells (`CAM_EV_MIN`,
    `CAM_EV_MAX`, `CAM_EV_STEP`) or shows other ones.
    ``online`` says whether the camera is there to be asked. ``shutter_s``: the exposure time to
    ask for; None leaves the camera's own.
    """

    def __init__(
        self,
        wire: Wire,
        component_id: int,
        clock: Clock,
        online: Callable[[], bool],
        step_ev: float,
        shutter_s: float | None = None,
    ) -> None:
        self._parameters = Parameters(wire, component_id, extended=True)
        self._clock = clock
        self._online = online
        self._wanted: float | None = None
        self._tried: float | None = None
        self._silences = 0
        self._heard = False
        self._wake = asyncio.Event()
        self.step_ev = step_ev
        self.min_ev = -3.0
        self.max_ev = 3.0
        self.manual = False
        """EV is absolute; otherwise it biases the camera's own automatic."""
        self.known = False
        """The camera was asked for what it has."""
        self.ev: float | None = None
        """Applied EV; None where the camera has no EV control (or was not asked yet)."""
        self.ev_stamp_s = float("-inf")
        """Mission time at which the camera confirmed it."""
        self.shutter_s: float | None = None
        """Exposure time in force, as the camera last said."""
        self._wanted_shutter_s = shutter_s
        self.refusals = 0
        """Wishes in a row that the camera refused or changed."""

    def want(self, ev: float) -> None:
        """Ask for an EV; it is snapped to the camera's steps."""
        if not math.isfinite(ev):
            return
        snapped = self.snap(ev)
        if snapped != self._wanted:
            self._wanted = snapped
            self._wake.set()

    def snap(self, ev: float) -> float:
        """Return the nearest EV that the camera has."""
        nearest = round(ev / self.step_ev) * self.step_ev
        return max(self.min_ev, min(self.max_ev, nearest))

    async def run(self) -> None:
        """Learn what the camera has, then apply wishes until cancelled.

        A camera that went away and came back has forgotten its mode: it is asked and told anew.
        """
        while True:
            online = self._online()
            try:
                if online and not self.known:
                    await self._learn()
                elif not online and self._heard:
                    self.known, self._silences = False, 0
                if online and self.known:
                    await self._apply_newest()
            except (Refused, LinkFailed) as error:
                self.refusals += 1
                self._tried = None  # tried again, for the answer may only have been lost
                if self.refusals == 1:
                    _log.warning("exposure: %s", error)
                await asyncio.sleep(_RETRY_S if self.refusals > 1 else 0.0)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._wake.wait(), _LOOK_S)
            self._wake.clear()

    async def _apply_newest(self) -> None:
        wanted = self._wanted
        if self.ev is None or wanted is None or wanted == self._tried:
            return
        self._tried = wanted
        if abs(wanted - self.ev) >= _SAME_EV:
            await self._apply(wanted)

    async def _learn(self) -> None:
        values = await self._parameters.read((_EV, _MODE, _SHUTTER))
        if not values:
            # No answer at all is not yet a camera without control; it is asked again.
            self._silences += 1
            self.known = self._silences >= _SILENCES
            return
        self._heard = True
        self._tried = None
        if _MODE in values and values[_MODE] != _MANUAL:
            try:
                await self._parameters.set(_MODE, _MANUAL)
                values[_MODE] = _MANUAL
            except Refused as error:
                _log.info("exposure stays automatic, EV biases it: %s", error)
        if self._wanted_shutter_s is not None and _SHUTTER in values:
            try:
                await self._parameters.set(_SHUTTER, self._wanted_shutter_s)
            except Refused as error:
                _log.info("the shutter stays the camera's own: %s", error)
            values |= await self._parameters.read((_SHUTTER,))
        limits = await self._parameters.read((_EV_MIN, _EV_MAX, _EV_STEP))
        self.min_ev = limits.get(_EV_MIN, self.min_ev)
        self.max_ev = limits.get(_EV_MAX, self.max_ev)
        if limits.get(_EV_STEP, 0.0) > 0:
            self.step_ev = limits[_EV_STEP]
        self.manual = values.get(_MODE) == _MANUAL
        self.ev = values.get(_EV)
        self.shutter_s = values.get(_SHUTTER)
        self.ev_stamp_s = self._clock.now_s()
        self.known = True

    async def _apply(self, wanted: float) -> None:
        await self._parameters.set(_EV, wanted)
        confirmed_s = self._clock.now_s()
        told = await self._parameters.read((_EV, _SHUTTER))
        applied = told.get(_EV)
        self.shutter_s = told.get(_SHUTTER, self.shutter_s)
        if applied is None:
            raise Refused(f"EV {wanted:+.2f} was acknowledged but cannot be read back")
        self.ev, self.ev_stamp_s = applied, confirmed_s
        if abs(applied - wanted) < _SAME_EV:
            self.refusals = 0
            return
        self.refusals += 1
        if self.refusals == 1:
            _log.warning("exposure: the camera applied EV %+.2f for %+.2f", applied, wanted)
        # A camera that clamps has shown its limit; one that rounds, only its steps.
        if applied < wanted - self.step_ev and applied > self.min_ev:
            self.max_ev = applied
        elif applied > wanted + self.step_ev and applied < self.max_ev:
            self.min_ev = applied
