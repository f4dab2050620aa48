"""What surfaces look like: albedo by place, with grime, erosion and defects. Compiled, float32.

Blade places are (blade metre, arc): metres from the root flange and metres along the skin from the
leading edge, positive on the pressure side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from perception.values import Float32

_BIN_M = 0.5
_BLADES = 3
_PER_BLADE = 26


@dataclass(frozen=True, slots=True, eq=False)
class Defects:
    """Damage on the three blades, sorted into bins of blade metres for quick look-up."""

    table: Float32
    """(D, 6) metre, arc, half length (along the blade), half width, slope, darkness 0-1."""
    first: NDArray[np.int32]
    """(3, B + 1) rows of ``order`` that belong to a bin of 0.5 m."""
    order: NDArray[np.int32]


def draw_defects(length_m: float, chord_m: Float32, seed: int) -> Defects:
    """Draw cracks, chips, lightning burns and oil streaks.

    ``chord_m``: (N,) chord at N even stations from root to tip.
    """
    rng = np.random.default_rng([seed, 0xDE])
    bins = int(length_m / _BIN_M) + 1
    rows: list[tuple[float, ...]] = []
    members: list[list[list[int]]] = [[[] for _ in range(bins)] for _ in range(_BLADES)]
    for blade in range(_BLADES):
        for _ in range(_PER_BLADE):
            share = float(rng.beta(1.6, 1.1))
            chord = float(np.interp(share, np.linspace(0, 1, len(chord_m)), chord_m))
            row = (share * length_m, float(rng.uniform(-0.9, 0.9)) * chord, *_kind(rng, chord))
            reach = row[2] + abs(row[4]) * row[3]
            low = max(0, int((row[0] - reach) / _BIN_M))
            for k in range(low, min(bins, int((row[0] + reach) / _BIN_M) + 1)):
                members[blade][k].append(len(rows))
            rows.append(row)
    order = [row for blade_bins in members for one_bin in blade_bins for row in one_bin]
    counts = np.array([[len(one_bin) for one_bin in blade] for blade in members])
    ends = np.cumsum(counts.ravel()).reshape(counts.shape)
    first = np.concatenate([ends[:, :1] - counts[:, :1], ends], axis=1)
    return Defects(
        np.array(rows, np.float32), first.astype(np.int32), np.array(order or [0], np.int32)
    )


def _kind(rng: np.random.Generator, chord_m: float) -> tuple[float, float, float, float]:
    """Return half length, half width, slope and darkness of one defect."""
    kind = float(rng.random())
    if kind < 0.4:  # crack: a thin line across the blade
        return 0.004, float(rng.uniform(0.05, 0.25)) * chord_m, float(rng.normal(0, 0.3)), 0.75
    if kind < 0.7:  # chip or burn
        size = float(rng.uniform(0.015, 0.06))
        return size, size * float(rng.uniform(0.6, 1.4)), 0.0, float(rng.uniform(0.4, 0.85))
    # streak of oil or dirt, along the blade
    return float(rng.uniform(0.3, 1.6)), float(rng.uniform(0.02, 0.08)), 0.0, 0.25


@njit(cache=True, nogil=True, fastmath=True, inline="always")
def _hash(x: int, y: int) -> float:  # pragma: no cover - compiled
    n = np.uint32(x) * np.uint32(374761393) + np.uint32(y) * np.uint32(668265263)
    n = (n ^ (n >> np.uint32(13))) * np.uint32(1274126177)
    return float((n ^ (n >> np.uint32(16))) & np.uint32(0xFFFF)) / 65535.0


@njit(cache=True, nogil=True, fastmath=True)
def value_noise(x: float, y: float) -> float:  # pragma: no cover - compiled
    """Return smooth noise in [0, 1] with a grain of 1."""
    i, j = int(np.floor(x)), int(np.floor(y))
    u, v = x - i, y - j
    u, v = u * u * (3 - 2 * u), v * v * (3 - 2 * v)
    low = _hash(i, j) * (1 - u) + _hash(i + 1, j) * u
    high = _hash(i, j + 1) * (1 - u) + _hash(i + 1, j + 1) * u
    return low * (1 - v) + high * v


@njit(cache=True, nogil=True, fastmath=True)
def blade_albedo(
    blade: int,
    metre: float,
    arc: float,
    length_m: float,
    range_m: float,
    table: Float32,
    first: NDArray[np.int32],
    order: NDArray[np.int32],
) -> float:  # pragma: no cover - compiled
    """Return the albedo of gel coat at a place of a blade, seen from a distance."""
    albedo = 0.80 - 0.05 * value_noise(metre * 0.9 + 37.0 * blade, arc * 1.3)
    near = 1.0 if range_m < 30.0 else max(0.0, 1.0 - (range_m - 30.0) / 30.0)
    if near > 0.0:
        grain = value_noise(metre * 11.0, arc * 17.0 + 91.0 * blade) - 0.5
        albedo += 0.035 * near * grain
        # Seams of the mould and of the laminate's plies.
        seam = abs((metre * 0.25) % 1.0 - 0.5) * 4.0
        if seam < 0.006:
            albedo -= 0.08 * near
    share = metre / length_m
    front = abs(arc)
    if share > 0.45 and front < 0.16:
        # Rain erodes the outer leading edge: a dark core, frayed and pitted towards the sides.
        wear = min(1.0, (share - 0.45) / 0.35)
        frayed = value_noise(metre * 23.0 + 51.0 * blade, arc * 60.0)
        depth = (
            wear * (0.02 + 0.05 * value_noise(metre * 2.3 + 7.0, 0.5))
            - front
            + 0.05 * (frayed - 0.5)
        )
        if depth > 0.0:
            albedo -= min(0.34, 9.0 * depth)
    elif share < 0.12:
        albedo -= 0.10 * value_noise(metre * 0.6, arc * 4.0)  # grease of the bearing
    bin_ = int(metre / 0.5)
    if 0 <= bin_ < first.shape[1] - 1:
        for k in range(first[blade, bin_], first[blade, bin_ + 1]):
            row = order[k]
            across = arc - table[row, 1]
            along = metre - table[row, 0] - table[row, 4] * across
            far = np.hypot(along / table[row, 2], across / table[row, 3])
            if far < 1.0:
                albedo *= 1.0 - table[row, 5] * min(1.0, 2.5 * (1.0 - far) + 0.3)
    return max(0.04, albedo)
