"""LZF, the compression inside binary_compressed PCD files (format of LibLZF by Marc Lehmann)."""

from __future__ import annotations

import numpy as np
from numba import njit

from perception.values import Bytes


def decompress(packed: bytes, size: int) -> bytes | None:
    """Return the ``size`` bytes that were packed, or None where the data are not such."""
    out = np.zeros(size, np.uint8)
    whole = _unpack(np.frombuffer(packed, np.uint8), out)
    return out.tobytes() if whole else None


@njit(cache=True, nogil=True)
def _unpack(packed: Bytes, out: Bytes) -> bool:  # pragma: no cover - compiled
    """Write what was packed; False where a reference or length leads outside."""
    i, o = 0, 0
    while i < len(packed):
        control = int(packed[i])
        i += 1
        if control < 32:  # that many bytes and one more stand as they are
            run = control + 1
            if i + run > len(packed) or o + run > len(out):
                return False
            for k in range(run):
                out[o + k] = packed[i + k]
            i += run
            o += run
            continue
        run = control >> 5  # a run seen before, so far back
        if run == 7:
            if i >= len(packed):
                return False
            run += int(packed[i])
            i += 1
        if i >= len(packed):
            return False
        back = ((control & 31) << 8) + int(packed[i]) + 1
        i += 1
        run += 2
        if back > o or o + run > len(out):
            return False
        for k in range(run):
            out[o + k] = out[o + k - back]
        o += run
    return o == len(out)
