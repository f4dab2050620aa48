"""A gate before sockets: while it is shut the kernel throws their datagrams away, unread.

A filter of the kernel's own machine (classic BPF, `man 7 socket`) drops what comes before it is
queued and before anybody is woken. Where there is no such filter (only Linux has it) the gate
stays open, and whoever reads must pass over what comes.
"""

from __future__ import annotations

import contextlib
import ctypes
import socket
import struct

#: SO_ATTACH_FILTER and SO_DETACH_FILTER of Linux; Python does not name them.
_ATTACH, _DETACH = 26, 27
#: One instruction, BPF_RET | BPF_K: keep no byte of the datagram.
_KEEP_NOTHING = struct.pack("HBBI", 0x06, 0, 0, 0)


class Gate:
    """Lets datagrams through to sockets, or none of them. Starts open."""

    def __init__(self, *sockets: socket.socket) -> None:
        self._sockets = sockets
        self.shut = False

    def close(self) -> bool:
        """Let nothing more through; False where this system cannot do so."""
        if self.shut:
            return True
        instruction = ctypes.create_string_buffer(_KEEP_NOTHING)
        program = struct.pack("HP", 1, ctypes.addressof(instruction))
        try:
            for sock in self._sockets:
                sock.setsockopt(socket.SOL_SOCKET, _ATTACH, program)
        except OSError:
            self._let_through()
            return False
        self.shut = True
        return True

    def open(self) -> None:
        """Let everything through again, from now on."""
        if self.shut:
            self._let_through()
            self.shut = False

    def _let_through(self) -> None:
        for sock in self._sockets:
            with contextlib.suppress(OSError):  # none was attached
                sock.setsockopt(socket.SOL_SOCKET, _DETACH, 0)
