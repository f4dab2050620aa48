"""Parameters of the autopilot or of a camera, read and set through MAVSDK.

PX4 puts the bytes of an integer into the float of PARAM_VALUE; MAVSDK knows which autopilot does
so, and the extended protocol of cameras beside it.
"""

from __future__ import annotations

import contextlib

from mavsdk.plugins.param import Param, ParamError, ParamResult, ProtocolVersion

from drivers.autopilot_errors import Refused
from drivers.autopilot_wire import Wire

_NAME_LENGTH = 16


class Parameters:
    """Parameters of one component."""

    def __init__(self, wire: Wire, component_id: int = 1, *, extended: bool = False) -> None:
        self._wire = wire
        self._plugin = Param(wire.plugin_system())
        self._integer: dict[str, bool] = {}
        if extended or component_id != 1:
            protocol = ProtocolVersion.EXT if extended else ProtocolVersion.V1
            # MAVSDK 4.1 answers UNKNOWN here although it does what it was asked.
            with contextlib.suppress(ParamError):
                self._plugin.select_component(component_id, protocol)

    async def read(self, names: tuple[str, ...]) -> dict[str, float]:
        """Return the values of the named parameters; those that do not exist are left out."""
        values: dict[str, float] = {}
        for name in names:
            value = await self._read_one(name)
            if value is not None:
                values[name] = value
        return values

    async def set(self, name: str, value: float) -> None:
        """Set one parameter; `Refused` says why it could not be set."""
        if name not in self._integer and await self._read_one(name) is None:
            raise Refused(f"parameter {name}: does not exist, or no answer")
        try:
            if self._integer[name]:
                await self._wire.call(lambda: self._plugin.set_param_int(name, round(value)))
            else:
                await self._wire.call(lambda: self._plugin.set_param_float(name, float(value)))
        except ParamError as error:
            raise Refused(f"parameter {name} = {value:g}: {_words(error)}") from error

    async def _read_one(self, name: str) -> float | None:
        if len(name) > _NAME_LENGTH:
            return None
        order = (self._integer[name],) if name in self._integer else (True, False)
        for integer in order:
            get = self._plugin.get_param_int if integer else self._plugin.get_param_float
            try:
                value = await self._wire.call(lambda get=get: get(name))  # type: ignore[misc] # mypy does not infer a lambda with a default
            except ParamError as error:
                if error.result in (ParamResult.WRONG_TYPE, ParamResult.TYPE_MISMATCH):
                    continue
                return None
            self._integer[name] = integer
            return float(value)
        return None


def _words(error: ParamError) -> str:
    return str(error.result.name).lower().replace("_", " ")
