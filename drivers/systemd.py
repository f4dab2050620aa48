"""What systemd is told of a service (`man sd_notify`); elsewhere nothing is sent."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping


class Systemd:
    """The notification socket of a service of Type=notify."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        """Read NOTIFY_SOCKET and WATCHDOG_USEC of ``environment``, or of this process."""
        told = os.environ if environment is None else environment
        path = told.get("NOTIFY_SOCKET", "")
        # A name that begins with @ stands for one in the abstract name space.
        self._path = "\0" + path[1:] if path.startswith("@") else path
        usec = told.get("WATCHDOG_USEC", "")
        self.watchdog_s: float | None = int(usec) / 1e6 if usec.isdecimal() else None
        """Silence after which we are killed; None: no watchdog."""

    @property
    def listens(self) -> bool:
        """Whether anybody is told anything."""
        return bool(self._path)

    def ready(self, words: str) -> None:
        """Say that the service is up."""
        self._send(f"READY=1\nSTATUS={words}")

    def alive(self, words: str) -> None:
        """Feed the watchdog, and say how things stand."""
        self._send(f"WATCHDOG=1\nSTATUS={words}")

    def stopping(self) -> None:
        """Say that the service is ending."""
        self._send("STOPPING=1")

    def _send(self, text: str) -> None:
        if not self._path:
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
            sender.setblocking(False)
            try:
                sender.sendto(text.encode(), self._path)
            except OSError:
                # systemd does not listen, or not now: it will count that as silence.
                return
