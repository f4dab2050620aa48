"""UDP end points of the host: bound, never blocking, with the receive buffer asked for."""

from __future__ import annotations

import socket
from pathlib import Path


def bound(ip: str, port: int, *, shared: bool = False) -> socket.socket:
    """Return a UDP socket bound to an address that does not block; OSError where it cannot be."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.setblocking(False)
        if shared:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((ip, port))
    except OSError:
        sock.close()
        raise
    return sock


def ask_receive_buffer(sock: socket.socket, wanted_bytes: int) -> tuple[int, str]:
    """Ask for a receive buffer; return what was granted and, where it is less, what to do.

    The kernel grants silently what it likes. On Linux it reports twice the usable size.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, wanted_bytes)
    granted_bytes = sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    if Path("/proc/sys/net/core/rmem_max").exists():
        granted_bytes //= 2
    if granted_bytes >= wanted_bytes:
        return granted_bytes, ""
    return granted_bytes, (
        f"receive buffer of {granted_bytes} bytes granted, {wanted_bytes} wanted, packets may be "
        f"lost: run `sysctl -w net.core.rmem_max={wanted_bytes}`"
    )
