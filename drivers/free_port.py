"""A port of this computer that is free just now."""

from __future__ import annotations

import random
import socket

#: Below the ports that the system gives to whoever connects (32768 and up on Linux): such a port
#: may be given away between asking for it here and using it.
FIRST, LAST = 20000, 32000
TRIES = 100


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    """Return a port of 127.0.0.1 that nobody listens on; ``kind``: of socket, TCP or UDP.

    Raises `OSError` where a hundred ports in a row are taken.
    """
    # Not from the seeded generator of whoever asks: two runs of one seed stand side by side.
    draw = random.SystemRandom()
    for _ in range(TRIES):
        port = draw.randrange(FIRST, LAST)
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise OSError(f"no free port between {FIRST} and {LAST}")
