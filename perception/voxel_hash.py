"""Open-addressing hash of voxels: the memory under every map here (numba, no Python objects).

A voxel is its three integer indices packed into one positive int64 key; slots hold the row of the
voxel in its owner's arrays. Linear probing, load at most one half, power-of-two sizes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Callable

Int64 = NDArray[np.int64]
EMPTY = -1
#: Indices of +-2^20 voxels fit the key: 200 km at 0.2 m.
OFFSET = 1 << 20
MASK = (1 << 21) - 1


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile with numba, kept on disk, releasing the GIL (numba carries no types)."""
    wrapped: Callable[..., Any] = numba.njit(cache=True, nogil=True, fastmath=False)(function)
    return wrapped


@compiled
def pack(i: int, j: int, k: int) -> int:
    """Return the key of a voxel."""
    return ((i + OFFSET) & MASK) << 42 | ((j + OFFSET) & MASK) << 21 | ((k + OFFSET) & MASK)


@compiled
def slot_of(keys: Int64, key: int) -> int:
    """Return the slot that holds a key, or the free one where it belongs."""
    mask = len(keys) - 1
    # Fibonacci hashing: neighbouring voxels differ in few bits, the product spreads them. Wrapped
    # to int64 throughout; the arithmetic shift is masked right after.
    slot = ((key * -7046029254386353131) >> 20) & mask
    while keys[slot] != EMPTY and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@compiled
def rebuild(keys: Int64, rows: Int64, key_of_row: Int64, count: int) -> None:
    """Fill an empty table with the first ``count`` rows."""
    for row in range(count):
        slot = slot_of(keys, key_of_row[row])
        keys[slot] = key_of_row[row]
        rows[slot] = row
