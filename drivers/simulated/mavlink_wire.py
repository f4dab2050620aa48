"""The mock's end of a MAVLink link: datagrams, their delay, and their failures.

Messages are encoded and decoded by pymavlink; a datagram that is no MAVLink is counted and
forgotten. Arrival times are the kernel's where it gives them, so that a busy loop here is not
taken for a late sender there.
"""

from __future__ import annotations

import contextlib
import math
import socket
import struct
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from random import Random
from typing import Protocol
from urllib.parse import urlsplit

from pymavlink.dialects.v20 import development as mavlink

_SO_TIMESTAMPNS = 35
_STAMP = struct.Struct("<qq")
_SLOW_S = 0.5
_LOSS = 0.25
_FOREIGN_SYSTEM = 254


class Message(Protocol):
    """A MAVLink message as pymavlink decodes it; its fields are read with `getattr`."""

    def get_type(self) -> str:
        """Return the message's name."""
        ...

    def get_srcSystem(self) -> int:  # noqa: N802 (pymavlink's name)
        """Return the sender's system id."""
        ...

    def get_srcComponent(self) -> int:  # noqa: N802 (pymavlink's name)
        """Return the sender's component id."""
        ...

    def pack(self, mav: object) -> bytes:
        """Return the frame's bytes, with the packer's sequence and sender."""
        ...


def made(name: str, *fields: object) -> Message:
    """Return the message of a name (lower case) with its fields in pymavlink's order."""
    message: Message = getattr(mavlink, f"MAVLink_{name}_message")(*fields)
    return message


@dataclass(frozen=True, slots=True)
class Received:
    """One message with the monotonic time at which it reached this machine."""

    message: Message
    arrival_ns: int


@dataclass(slots=True)
class LinkCounts:
    """What went over the link."""

    sent: int = 0
    received: int = 0
    dropped: int = 0
    unreadable: int = 0


@dataclass(order=True, slots=True)
class _Due:
    time_s: float
    data: bytes = field(compare=False)


class MavlinkLink:
    """A UDP link to the other end of a MAVSDK URL."""

    def __init__(self, url: str, *, delay_s: float = 0.02, seed: int = 0) -> None:
        kind, host, port = _parse(url)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._peers: list[tuple[str, int]] = []
        if kind == "udpin":
            self._peers.append(("127.0.0.1" if host in ("", "0.0.0.0") else host, port))  # noqa: S104 (a wildcard read from a URL, not bound)
            self._socket.bind(("", 0))
        else:
            self._listen(host, port)
        # Without kernel stamps the time of reading stands in.
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._learns_peer = kind == "udpout"
        self._delay_s = delay_s
        self._random = Random(seed)
        self._packers: dict[tuple[int, int], object] = {}
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._out: deque[_Due] = deque()
        self._in: deque[tuple[float, Received]] = deque()
        self._word = "ok"
        self._last: bytes | None = None
        self.counts = LinkCounts()
        self.systems: set[int] = set()
        """System ids heard so far."""
        self.on_arrival: Callable[[Received], None] | None = None
        """Called at once for each message, before the link's delay."""
        self.on_bytes: Callable[[bytes], None] | None = None
        """Called at once for each datagram, to relay it."""

    def _listen(self, host: str, port: int) -> None:
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            words = error.strerror or str(error)
            raise ConnectionError(f"UDP {host or '*'}:{port}: {words}") from error

    def fileno(self) -> int:
        """Return the descriptor to wait on."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def fault(self, word: str) -> None:
        """Change how the link fails; see `_disturbed`."""
        self._word = word

    def read(self, now_s: float, when: Callable[[int], float] | None = None) -> None:
        """Take in all waiting datagrams; they are delivered after the link's delay.

        ``when`` gives the mission time of an arrival (monotonic ns): a reader that was kept from
        reading delivers each when it would have been; without it they all arrive now.
        """
        while True:
            try:
                data, extra, _, peer = self._socket.recvmsg(2048, 64)
            except BlockingIOError:
                return
            except OSError:
                # ICMP 'port unreachable' of a peer that is not up yet.
                continue
            if self.on_bytes is not None:
                self.on_bytes(data)
            if self._learns_peer and peer not in self._peers:
                self._peers = [peer]
            arrival_ns = _arrival_ns(extra)
            disturbed = self._disturbed(data)
            if disturbed is None or self._word == "stuck":
                continue
            data, delay_s = disturbed
            arrival_s = now_s if when is None else min(now_s, when(arrival_ns))
            for message in self._parser.parse_buffer(bytearray(data)) or []:
                self._take(Received(message, arrival_ns), arrival_s + delay_s)

    def _take(self, received: Received, due_s: float) -> None:
        if received.message.get_type() == "BAD_DATA":
            self.counts.unreadable += 1
            return
        self.counts.received += 1
        self.systems.add(received.message.get_srcSystem())
        if self.on_arrival is not None:
            self.on_arrival(received)
        self._in.append((due_s, received))

    def due(self, now_s: float) -> list[Received]:
        """Return the messages whose delay is over."""
        ready: list[Received] = []
        while self._in and self._in[0][0] <= now_s:
            ready.append(self._in.popleft()[1])
        return ready

    def send(self, message: Message, system: int, component: int, now_s: float) -> None:
        """Send one message after the link's delay."""
        if self._word == "wrong":
            system = _FOREIGN_SYSTEM
        packer = self._packers.get((system, component))
        if packer is None:
            packer = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
            self._packers[system, component] = packer
        data = bytes(message.pack(packer))
        # pack() does not count; the sequence must move for loss to be seen by the receiver.
        packer.seq = (packer.seq + 1) % 256  # type: ignore[attr-defined]  # pymavlink is untyped
        self.send_bytes(data, now_s)

    def send_bytes(self, data: bytes, now_s: float) -> None:
        """Send an encoded frame after the link's delay."""
        if self._word == "stuck":
            # The radio repeats its last frame for ever.
            data = self._last = self._last or data
        else:
            self._last = None
        disturbed = self._disturbed(data)
        if disturbed is not None:
            self._out.append(_Due(now_s + disturbed[1], disturbed[0]))

    def flush(self, now_s: float) -> None:
        """Put on the wire what is due."""
        while self._out and self._out[0].time_s <= now_s:
            data = self._out.popleft().data
            for peer in self._peers:
                try:
                    self._socket.sendto(data, peer)
                    self.counts.sent += 1
                except OSError:
                    # A full buffer, or nobody there: a radio link loses such frames too.
                    self.counts.dropped += 1

    def _disturbed(self, data: bytes) -> tuple[bytes, float] | None:
        """Return the frame and its delay under the failure word; None where it is lost."""
        word = self._word
        if word == "off" or (word == "intermittent" and self._random.random() < _LOSS):
            self.counts.dropped += 1
            return None
        if word in ("slow", "delayed"):
            return data, _SLOW_S
        if word == "garbage":
            spoiled = bytearray(data)
            spoiled[self._random.randrange(len(spoiled))] ^= 0xFF
            return bytes(spoiled), self._delay_s
        return data, self._delay_s


def _arrival_ns(extra: list[tuple[int, int, bytes]]) -> int:
    """Return the monotonic time of arrival from the kernel's stamp of the wall clock."""
    now_ns = time.monotonic_ns()
    for level, kind, data in extra:
        if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS and len(data) >= _STAMP.size:
            seconds, nanoseconds = _STAMP.unpack_from(data)
            waited_ns = time.time_ns() - (seconds * 1_000_000_000 + nanoseconds)
            if 0 <= waited_ns < 1_000_000_000:
                return now_ns - int(waited_ns)
    return now_ns


def _parse(url: str) -> tuple[str, str, int]:
    """Return kind, host and port of a MAVSDK URL that UDP can serve."""
    parts = urlsplit(url)
    if parts.scheme not in ("udpin", "udpout") or parts.port is None:
        raise ValueError(f"the mock autopilot needs udpin://HOST:PORT or udpout://HOST:PORT: {url}")
    return parts.scheme, parts.hostname or "", parts.port


def finite(value: float, fallback: float = 0.0) -> float:
    """Return the value, or the fallback for NaN and infinity (MAVLink leaves fields unset so)."""
    return value if math.isfinite(value) else fallback
