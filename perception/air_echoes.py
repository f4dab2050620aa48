"""Fog, drizzle and dust: echoes of the air itself, told from what stands in it.

The air scatters back from every direction, mostly from the first metres, and lets most rays pass;
a surface stands in some directions and stops all the rays that meet it. So the density of echoes
that is found in most directions alike, shell by shell, is the air's. Near the sensor only places
much denser than that, in two scans running, count as something solid. In clear air no shell has
echoes all round, and nothing is left out.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from perception.values import Float

Bools = NDArray[np.bool_]
Int64 = NDArray[np.int64]

#: Farther than this the air sends nothing back that a LiDAR of this class notices.
REACH_M = 15
SECTORS = 24
#: A surface may fill this many sectors of a shell before it is taken for air.
FILLED_SECTORS = 8
#: Each scan counts so much against the ones before: 1 s at 10 Hz.
NEWEST_SHARE = 0.1
#: Shell by shell the air's echoes become at most so much fewer: beyond the shell where the last
#: were counted some are expected still.
FALL_OFF = 0.5
#: Fewer expected in a cell than this, and the air is clear there.
CLEAR = 1e-5
#: Cells: fine where a surface returns hundreds of points in one, coarse beyond.
FINE_M, COARSE_M, FINE_WITHIN_M = 0.5, 1.5, 8.0


class AirEchoes:
    """What of each scan is air, learned from the scans of the last second."""

    def __init__(self, *, field_of_view_sr: float) -> None:
        """Start in clear air. ``field_of_view_sr``: solid angle that the sensor looks into."""
        inner = np.arange(REACH_M, dtype=np.float64)
        self._shell_m3 = field_of_view_sr * ((inner + 1) ** 3 - inner**3) / 3
        self._count = np.zeros((REACH_M, SECTORS))
        self._dense: Int64 = np.empty(0, np.int64)

    @property
    def expected_per_m3(self) -> Float:
        """(15,) echoes of the air a scan and cubic metre, by metre of range; zeros when clear."""
        spread = np.sort(self._count, axis=1)[:, : SECTORS - FILLED_SECTORS]
        found = spread.mean(axis=1) * SECTORS / self._shell_m3
        for shell in range(1, REACH_M):
            found[shell] = max(found[shell], FALL_OFF * found[shell - 1])
        return np.asarray(found)

    def solid(self, points_w: Float, origin_w: Float) -> Bools:
        """Return which points (N, 3) of a scan are not the air's, seen from the sensor (3,).

        World metres. In clear air, and beyond 15 m, all are solid.
        """
        away = points_w - origin_w
        range_m = np.sqrt(np.einsum("ij,ij->i", away, away))
        near = np.flatnonzero(range_m < REACH_M)
        shell = range_m[near].astype(np.int64)
        self._learn(away[near], shell)
        expected = self.expected_per_m3
        solid = np.ones(len(points_w), bool)
        if not (expected * COARSE_M**3 > CLEAR).any():
            self._dense = self._dense[:0]
            return solid
        coarse = range_m[near] >= FINE_WITHIN_M
        size_m = np.where(coarse, COARSE_M, FINE_M)
        key = _cells(points_w[near], size_m, coarse)
        _, cell, hits = np.unique(key, return_inverse=True, return_counts=True)
        air = expected[shell] * size_m**3
        # What chance gathers in a cell stays below this, also where the pattern is twice as thick.
        is_dense = hits[cell] > 2.0 + 2.0 * air + 5.0 * np.sqrt(air)
        solid[near] = (air <= CLEAR) | (is_dense & np.isin(key, self._dense))
        self._dense = np.unique(key[is_dense])
        return solid

    def _learn(self, away: Float, shell: Int64) -> None:
        bearing = np.arctan2(away[:, 1], away[:, 0])
        sector = ((bearing + math.pi) * (SECTORS / (2 * math.pi))).astype(np.int64) % SECTORS
        here = np.bincount(shell * SECTORS + sector, minlength=REACH_M * SECTORS)
        self._count += NEWEST_SHARE * (here.reshape(REACH_M, SECTORS) - self._count)


def _cells(points_w: Float, size_m: Float, coarse: Bools) -> Int64:
    """Return one number a point: its cell of the grid of its size."""
    place = np.floor(points_w / size_m[:, None]).astype(np.int64) + (1 << 19)
    packed: Int64 = (place[:, 0] << 42) | (place[:, 1] << 21) | place[:, 2]
    return packed | (coarse.astype(np.int64) << 62)
