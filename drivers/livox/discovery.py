"""Find a sensor whose address is not known.

The sensor answers a discovery to the broadcast address, at the port that asked. A socket bound to
one address does not hear broadcasts, so a second one listens on all of them.
"""

from __future__ import annotations

import select
import socket
import time
from contextlib import ExitStack

from drivers.livox.frames import (
    DISCOVERY_PORT,
    MAX_FRAME_BYTES,
    Command,
    Discovered,
    Frame,
    decode_discovered,
    decode_frame,
    encode_frame,
)
from drivers.livox.sockets import bound


def discover(
    host_ip: str,
    serial: str = "",
    *,
    wait_s: float = 0.5,
    target: tuple[str, int] = ("255.255.255.255", DISCOVERY_PORT),
) -> Discovered | None:
    """Ask once who is there; return the first sensor, or the one of a serial number, or None.

    Waits for ``wait_s`` of wall time: the network knows no other. OSError where we cannot ask.
    """
    with ExitStack() as stack:
        ask = stack.enter_context(bound(host_ip, 0, shared=True))
        port = ask.getsockname()[1]
        hear = stack.enter_context(bound("", port, shared=True))
        ask.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        ask.sendto(encode_frame(Frame(1, Command.DISCOVER, False, False, b"")), target)
        end_s = time.monotonic() + wait_s
        while (left_s := end_s - time.monotonic()) > 0:
            for sock in select.select([ask, hear], [], [], left_s)[0]:
                found = _read(sock)
                if found is not None and serial in {"", found.serial}:
                    return found
    return None


def _read(sock: socket.socket) -> Discovered | None:
    frame = decode_frame(sock.recv(MAX_FRAME_BYTES))
    if frame is None or not frame.is_ack or frame.command != Command.DISCOVER:
        return None
    return decode_discovered(frame.data)
