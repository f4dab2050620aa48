"""Sends datagrams when their mission time has come, from a thread of its own."""

from __future__ import annotations

import logging
import socket
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers.clock import Clock

_LOG = logging.getLogger(__name__)

_NAP_S = 0.003
_BURST = 16
#: Where the thread has waited long for its turn, more leave at once: still half of what the
#: kernel's ordinary receive buffer holds.
_LATE_BURST = 44
_LATE_S = 0.12
_BURST_PAUSE_S = 0.0012
#: Older batches are thrown away: a sensor has no memory to speak of.
_LIMIT = 20_000


@dataclass(slots=True)
class Timed:
    """One datagram, its way, and the mission time at which it leaves."""

    due_s: float
    data: bytes | memoryview
    sock: socket.socket
    to: tuple[str, int]


class PacedSender:
    """A queue of datagrams in order of time, and the thread that sends them.

    What is due already leaves at once, but never many datagrams on end: a host with the kernel's
    ordinary receive buffer, which holds about ninety of them, would lose some.

    Args:
        clock: mission time.
        on_wake: called in the thread every few milliseconds, for what is sent at once.
    """

    def __init__(self, clock: Clock, on_wake: Callable[[], None]) -> None:
        self._clock = clock
        self._on_wake = on_wake
        self._queue: deque[Timed] = deque()
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="mid360-sender", daemon=True)
        self.sent = 0
        self.thrown_away = 0

    def start(self) -> None:
        """Begin to send."""
        self._thread.start()

    def close(self) -> None:
        """Stop; what is queued is not sent."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def clear(self) -> None:
        """Forget what is queued."""
        with self._lock:
            self._queue.clear()

    def put(self, datagrams: Sequence[Timed]) -> None:
        """Queue datagrams, in order of time."""
        with self._lock:
            self._queue.extend(datagrams)
            while len(self._queue) > _LIMIT:
                self._queue.popleft()
                self.thrown_away += 1

    def unsent_since_s(self) -> float | None:
        """Return the mission time of the oldest datagram that has not left, None for none."""
        with self._lock:
            return self._queue[0].due_s if self._queue else None

    def _run(self) -> None:
        while not self._stop.is_set():
            self._on_wake()
            burst = self._due()
            for timed in burst:
                try:
                    timed.sock.sendto(timed.data, timed.to)
                except OSError as error:
                    # A full buffer or a cable out: lost, as on the wire.
                    _LOG.debug("LiDAR packet not sent: %s", error)
                else:
                    self.sent += 1
            self._stop.wait(_BURST_PAUSE_S if len(burst) >= _BURST else _NAP_S)

    def _due(self) -> list[Timed]:
        now_s = self._clock.now_s()
        burst: list[Timed] = []
        with self._lock:
            queue = self._queue
            late = bool(queue) and now_s - queue[0].due_s > _LATE_S
            most = _LATE_BURST if late else _BURST
            while queue and len(burst) < most and queue[0].due_s <= now_s:
                burst.append(queue.popleft())
        return burst
