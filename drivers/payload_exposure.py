"""Exposure of a MAVLink camera through its extended parameters.

`CAM_EV` is the exposure value; `CAM_EXPMODE` (0 automatic, 1 manual) says whether it is absolute
or biases an automatic exposure: manual is chosen where the camera has it. `CAM_SHUTTER` is asked
to be as short as the flight wishes, where the camera lets it be set: a quick shutter and a higher
ISO blur less. A camera without `CAM_EV` is exposed by `CAM_SHUTTERSPD` and `CAM_ISO`, their values
at first hearing being EV 0; one without these has no control, and says so by None. Which values
there are, the camera's definition file tells, else the limits, else nobody. What the camera applied
is read back, because cameras clamp and round: the report is theirs, never the wish.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import Awaitable, Callable

from drivers.autopilot_errors import LinkFailed, Refused
from drivers.autopilot_parameters import Parameters
from drivers.autopilot_wire import Wire
from drivers.camera_definition import CameraDefinition, ParameterValues
from drivers.clock import Clock
from drivers.exposure_table import (
    SAME_EV,
    USUAL_ISOS,
    USUAL_SHUTTERS_S,
    ExposureTable,
    pair_ev,
    table_of_evs,
    table_of_pairs,
    table_that_fits,
)

_log = logging.getLogger(__name__)

_EV, _MODE, _SHUTTER = "CAM_EV", "CAM_EXPMODE", "CAM_SHUTTER"
_EV_MIN, _EV_MAX, _EV_STEP = "CAM_EV_MIN", "CAM_EV_MAX", "CAM_EV_STEP"
_SPEED, _ISO = "CAM_SHUTTERSPD", "CAM_ISO"
_MANUAL = 1.0
_RETRY_S = 2.0
_LOOK_S = 0.2
_SILENCES = 3


class ExposureControl:
    """Applies the newest EV asked for; wishes that were overtaken are never sent.

    ``step_ev``: the steps to snap to, within -3 to +3, unless the camera tells (`CAM_EV_MIN`,
    `CAM_EV_MAX`, `CAM_EV_STEP`) or shows other ones.
    ``online`` says whether the camera is there to be asked. ``shutter_s``: the exposure time to
    ask for; None leaves the camera's own. ``definition`` reads the camera's definition file.
    """

    def __init__(
        self,
        wire: Wire,
        component_id: int,
        clock: Clock,
        online: Callable[[], bool],
        step_ev: float,
        shutter_s: float | None = None,
        definition: Callable[[], Awaitable[CameraDefinition | None]] | None = None,
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
        self._definition = definition
        self._table: ExposureTable | None = None
        self._zero: tuple[float, float] | None = None
        """Shutter (s) and ISO that are EV 0, of a camera without EV."""
        self._answers: dict[float, float] = {}
        """By wish the EV that the camera applied, as far as it did not clamp."""
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
        if self._table is not None:
            bounded = max(self.min_ev, min(self.max_ev, ev))
            return self._table.nearest(bounded).ev
        nearest = round(ev / self.step_ev) * self.step_ev
        return max(self.min_ev, min(self.max_ev, nearest))

    @property
    def evs(self) -> tuple[float, ...]:
        """All EVs that there are, ascending, where the camera lists them; else there are steps."""
        listed = () if self._table is None else self._table.exposures
        return tuple(
            round(one.ev, 3)
            for one in listed
            if self.min_ev - SAME_EV <= one.ev <= self.max_ev + SAME_EV
        )

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
        if abs(wanted - self.ev) >= SAME_EV:
            await self._apply(wanted)

    async def _learn(self) -> None:
        values = await self._parameters.read((_EV, _MODE, _SHUTTER))
        if not values and not await self._parameters.read((_SPEED, _ISO)):
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
        self.manual = values.get(_MODE) == _MANUAL
        definition = {} if self._definition is None else await self._definition() or {}
        if _EV in values:
            await self._learn_evs(definition.get(_EV, ParameterValues()))
            self.ev = values[_EV]
        elif self.manual or _MODE not in values:
            await self._learn_pairs(definition)
            self.manual = self.ev is not None
        self.shutter_s = values.get(_SHUTTER, self.shutter_s)
        self.ev_stamp_s = self._clock.now_s()
        self.known = True

    async def _learn_evs(self, told: ParameterValues) -> None:
        """Take the EVs that there are: the list, else what the parameters say, else the file."""
        self._table = table_of_evs(_EV, told.options) if len(told.options) > 1 else None
        if self._table is not None:
            self.min_ev, self.max_ev = self._table.min_ev, self._table.max_ev
            self.step_ev = self._table.step_ev
            return
        limits = await self._parameters.read((_EV_MIN, _EV_MAX, _EV_STEP))
        least, most = limits.get(_EV_MIN, told.least), limits.get(_EV_MAX, told.most)
        step = limits.get(_EV_STEP, told.step)
        self.min_ev = self.min_ev if least is None else least
        self.max_ev = self.max_ev if most is None else most
        if step is not None and step > 0:
            self.step_ev = step

    async def _learn_pairs(self, definition: CameraDefinition) -> None:
        """Make EVs of shutter and ISO, where the camera has both and is manual."""
        pair = await self._parameters.read((_SPEED, _ISO))
        time_s, iso = pair.get(_SPEED, 0.0), pair.get(_ISO, 0.0)
        self._table = self.ev = None
        if time_s <= 0 or iso <= 0:
            return
        self._zero = self._zero or (time_s, iso)
        times = definition.get(_SPEED, ParameterValues()).options or USUAL_SHUTTERS_S
        isos = definition.get(_ISO, ParameterValues()).options or USUAL_ISOS
        longest_s = self._wanted_shutter_s or time_s
        self._table = table_of_pairs((_SPEED, times), (_ISO, isos), self._zero, longest_s)
        self.min_ev, self.max_ev = self._table.min_ev, self._table.max_ev
        self.step_ev = self._table.step_ev
        self.ev, self.shutter_s = pair_ev(time_s, iso, self._zero), time_s

    async def _apply(self, wanted: float) -> None:
        try:
            await self._set(wanted)
        except Refused:
            # The camera may have done it all the same, its answer late or lost.
            applied = await self._applied()
            if applied is None or abs(applied - wanted) >= SAME_EV:
                raise
        confirmed_s = self._clock.now_s()
        applied = await self._applied()
        if applied is None:
            raise Refused(f"EV {wanted:+.2f} was acknowledged but cannot be read back")
        self.ev, self.ev_stamp_s = applied, confirmed_s
        if abs(applied - wanted) < self.step_ev:
            self._answers[wanted] = applied
        if abs(applied - wanted) < SAME_EV:
            self.refusals = 0
            return
        self.refusals += 1
        if self.refusals == 1:
            _log.warning("exposure: the camera applied EV %+.2f for %+.2f", applied, wanted)
        # A camera that clamps has shown its limit; one that rounds, only its steps.
        if abs(applied - wanted) < self.step_ev and self._zero is None:
            self._learn_steps()
        elif applied < wanted - self.step_ev and applied > self.min_ev:
            self.max_ev = applied
        elif applied > wanted + self.step_ev and applied < self.max_ev:
            self.min_ev = applied

    async def _set(self, wanted: float) -> None:
        if self._zero is None or self._table is None:
            await self._parameters.set(_EV, wanted)
        else:
            for name, value in self._table.nearest(wanted).parameters:
                await self._parameters.set(name, value)

    def _learn_steps(self) -> None:
        """Take the steps that explain what the camera made of wishes so far."""
        table = table_that_fits(_EV, self._answers, (self.min_ev, self.max_ev))
        if table is not None:
            self._table, self.step_ev = table, table.step_ev
            _log.info("exposure: the camera's steps seem to be of %.2f EV", table.step_ev)

    async def _applied(self) -> float | None:
        """Read back what the camera made of a wish."""
        if self._zero is None:
            told = await self._parameters.read((_EV, _SHUTTER))
            self.shutter_s = told.get(_SHUTTER, self.shutter_s)
            return told.get(_EV)
        told = await self._parameters.read((_SPEED, _ISO))
        time_s, iso = told.get(_SPEED, 0.0), told.get(_ISO, 0.0)
        if time_s <= 0 or iso <= 0:
            return None
        self.shutter_s = time_s
        return pair_ev(time_s, iso, self._zero)
