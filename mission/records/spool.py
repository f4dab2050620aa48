"""A file that grows and whose disk may fail: nothing written twice, nothing torn in the middle.

What cannot be written now (the disk is full, or will not let itself be written) is kept and
written later, in order; when more is waiting than memory should hold, the file ends where it is,
readable up to there, and says why.
"""

from __future__ import annotations

import os
from pathlib import Path

MAX_WAITING_BYTES = 64 << 20
#: After a failure the disk is left alone for so many flushes.
_RESTED_FLUSHES = 10


class Spool:
    """A stream as the MCAP writer wants one: write, tell, flush."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: int | None = None
        self._waiting = bytearray()
        self._told = 0
        self._rest = 0
        self.fault = ""
        """Why bytes are waiting, or were lost; empty: all is on the disk's side."""
        self.ended = False
        """Too much waited: the file ends where it is."""

    def write(self, data: bytes) -> int:
        """Take bytes; they reach the file with the next flush."""
        self._told += len(data)
        if not self.ended:
            self._waiting += data
        return len(data)

    def tell(self) -> int:
        """Return how many bytes were ever taken."""
        return self._told

    def flush(self) -> None:
        """Hand what waits to the kernel: a killed process loses nothing of it. Never raises."""
        if self._rest > 0:
            self._rest -= 1
        else:
            self._try()
        if len(self._waiting) > MAX_WAITING_BYTES:
            self.ended = True
            self._waiting.clear()

    def _try(self) -> None:
        try:
            if self._file is None:
                flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
                self._file = os.open(self._path, flags, 0o644)
            while self._waiting:
                # A failing disk may take a part: only what it took is forgotten.
                del self._waiting[: os.write(self._file, self._waiting)]
            self.fault = ""
        except OSError as error:
            self.fault = error.strerror or str(error)
            self._rest = _RESTED_FLUSHES

    def close(self) -> None:
        """Write what still waits and leave the file; what does not fit is lost and named."""
        self._rest = 0
        self._try()
        self.ended = self.ended or bool(self._waiting)
        if self._file is not None:
            os.close(self._file)
            self._file = None
