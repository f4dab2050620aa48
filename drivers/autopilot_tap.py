"""The vehicle's link as bytes: what comes in and goes out, for whoever records it.

Flight's MAVSDK has one more connection, on loopback, that forwards; whoever is heard on it with a
heartbeat of the vehicle's own system (as MAVLink routes: a component of it) is given everything.
Until somebody is, nothing is sent; then a datagram a message, by MAVSDK's own threads. It says no
to nothing and holds nothing up. What is addressed to flight alone (COMMAND_ACK) stays with it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import common as mavlink

from drivers.socket_gate import Gate

if TYPE_CHECKING:
    from mavsdk import Mavsdk

_log = logging.getLogger(__name__)

TAP_FILE = "link-tap"
"""In the run directory: the port on which the link can be heard."""

#: MAV_COMP_ID_LOG and MAV_TYPE_LOG of MAVLink: something that logs.
_LOG_COMPONENT, _LOG_TYPE = 155, 41
_HEARTBEAT_S = 1.0
_SHORTEST = {0xFE: 8, 0xFD: 12}
"""Bytes round the payload of MAVLink 1 and 2."""
_SIGNED, _SIGNATURE_BYTES = 0x01, 13


def open_tap(mavsdk: Mavsdk, file: Path) -> None:
    """Let the link be heard on a free port of loopback and write the port to a file.

    A tap that cannot be opened is logged: a flight does not need it.
    """
    from mavsdk import ForwardingOption, MavsdkError

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        trial.bind(("127.0.0.1", 0))
        port = int(trial.getsockname()[1])
    try:
        mavsdk.add_any_connection_with_handle_and_forwarding(
            f"udpin://127.0.0.1:{port}", ForwardingOption.ON
        )
        file.write_text(f"{port}\n")
    except (MavsdkError, OSError) as error:
        _log.error("the vehicle's link will not be recorded: %s", error)


class TapListener(asyncio.DatagramProtocol):
    """Hears the link: ``take`` is called with every datagram, on the event loop."""

    def __init__(self, file: Path, system_id: int, take: Callable[[bytes], None]) -> None:
        self._file = file
        self._take = take
        self._wanted = False
        self._changed = asyncio.Event()
        packer = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=_LOG_COMPONENT)
        beat = mavlink.MAVLink_heartbeat_message(
            _LOG_TYPE, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
        )
        self._beat = bytes(beat.pack(packer))

    def datagram_received(self, data: bytes, _addr: object) -> None:
        """Hand over what MAVSDK sent."""
        self._take(data)

    def error_received(self, exc: Exception) -> None:
        """Nobody is there (any more): the next heartbeat tries again."""

    def want(self, wanted: bool) -> None:
        """Set whether the link is to be heard; at first it is not. On the event loop.

        Once heard, the other end goes on sending: what nobody wants costs nobody's time here.
        """
        if wanted != self._wanted:
            self._wanted = wanted
            self._changed.set()

    async def run(self) -> None:
        """Listen until cancelled, to whichever port the file names; flight may come and go."""
        loop = asyncio.get_running_loop()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.bind(("127.0.0.1", 0))
            gate = Gate(sock)
            transport, _ = await loop.create_datagram_endpoint(lambda: self, sock=sock)
            try:
                while True:
                    self._changed.clear()
                    if self._wanted:
                        gate.open()
                        with contextlib.suppress(OSError, ValueError):
                            transport.sendto(self._beat, ("127.0.0.1", int(self._file.read_text())))
                    else:
                        gate.close()
                    with contextlib.suppress(TimeoutError):
                        async with asyncio.timeout(_HEARTBEAT_S):
                            await self._changed.wait()
            finally:
                transport.close()


def frames(data: bytes) -> list[bytes]:
    """Cut a datagram into MAVLink frames; what is none is left out."""
    found, at = [], 0
    while at + 3 <= len(data):
        around = _SHORTEST.get(data[at])
        if around is None:
            at += 1
            continue
        end = at + around + data[at + 1]
        if data[at] == 0xFD and data[at + 2] & _SIGNED:
            end += _SIGNATURE_BYTES
        if end > len(data):
            break
        found.append(data[at:end])
        at = end
    return found
