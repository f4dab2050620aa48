"""The camera's definition file: which values its parameters take (MAVLink camera definition XML).

CAMERA_INFORMATION names the file; it is fetched over HTTP. It comes from outside: whatever is
wrong with it, there is then none, and the camera is asked parameter by parameter.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import urllib.error
import urllib.request
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass

from drivers.autopilot_errors import LinkFailed, Refused
from drivers.autopilot_wire import Received, Wire

_log = logging.getLogger(__name__)

_REQUEST_MESSAGE, _CAMERA_INFORMATION = 512, 259
_ANSWER_S = 1.0
_FETCH_S = 3.0
MAX_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class ParameterValues:
    """What one parameter may be set to."""

    options: tuple[float, ...] = ()
    """Ascending; empty where it is not a list."""
    least: float | None = None
    most: float | None = None
    step: float | None = None


CameraDefinition = Mapping[str, ParameterValues]


def parse_definition(text: bytes) -> CameraDefinition | None:
    """Return the parameters of a definition file by name, None where it is none."""
    # Entities are no part of a definition, and the usual way to make a parser burst.
    if len(text) > MAX_BYTES or b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        return None
    try:
        root = ET.fromstring(text)  # noqa: S314 - bounded, and without entities: see above
    except (ET.ParseError, ValueError):
        return None
    if root.tag != "mavlinkcamera":
        return None
    found: dict[str, ParameterValues] = {}
    for parameter in root.iter("parameter"):
        name = parameter.get("name")
        if name:
            values = {_number(option.get("value")) for option in parameter.iter("option")}
            found[name] = ParameterValues(
                tuple(sorted(value for value in values if value is not None)),
                _number(parameter.get("min")),
                _number(parameter.get("max")),
                _number(parameter.get("step")),
            )
    return found


class DefinitionFile:
    """Finds and reads a camera's definition file."""

    def __init__(self, wire: Wire, component_id: int) -> None:
        self._wire = wire
        self._component = component_id
        self._loop = asyncio.get_running_loop()
        self._uri: asyncio.Future[str] | None = None
        wire.listen("CAMERA_INFORMATION", self._take, component_id)

    async def read(self) -> CameraDefinition | None:
        """Return the camera's definition, None where it has none that can be had."""
        self._uri = self._loop.create_future()
        try:
            await self._wire.command(
                "camera information",
                _REQUEST_MESSAGE,
                (float(_CAMERA_INFORMATION),),
                self._component,
                tries=1,
            )
            uri = await asyncio.wait_for(self._uri, _ANSWER_S)
        except (Refused, LinkFailed, TimeoutError):
            return None
        if not uri.startswith(("http://", "https://")):
            return None
        text = await asyncio.to_thread(_fetched, uri)
        definition = None if text is None else parse_definition(text)
        if definition is None:
            _log.warning("camera: its definition file %s cannot be used", uri)
        return definition

    def _take(self, message: Received) -> None:
        uri = message.text("cam_definition_uri")
        with contextlib.suppress(RuntimeError):  # the loop is gone: nobody waits any more
            self._loop.call_soon_threadsafe(self._hand_over, uri)

    def _hand_over(self, uri: str) -> None:
        if self._uri is not None and not self._uri.done():
            self._uri.set_result(uri)


def _fetched(uri: str) -> bytes | None:
    try:
        with urllib.request.urlopen(uri, timeout=_FETCH_S) as answer:  # noqa: S310 - http only
            return bytes(answer.read(MAX_BYTES + 1))
    except (urllib.error.URLError, OSError, ValueError):
        return None


def _number(text: str | None) -> float | None:
    try:
        value = float(text) if text is not None else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None
