"""Where vehicle and camera truly were: the last seconds of states, interpolated at any time."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.simulated.link import TruthState
from perception.values import Float, Float32

_KEEP = 512  # 10 s at 50 states a second


class TruthHistory:
    """The newest states of the world, in rising time."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._states: list[TruthState] = []

    @property
    def newest_s(self) -> float:
        """Mission time of the newest state; -inf before the first."""
        return self._times[-1] if self._times else -float("inf")

    @property
    def oldest_s(self) -> float:
        """Mission time of the oldest state kept; inf before the first."""
        return self._times[0] if self._times else float("inf")

    def add(self, state: TruthState) -> None:
        """Take a newer state; one that is not newer is left out."""
        if state.t_s <= self.newest_s:
            return
        self._times.append(state.t_s)
        self._states.append(state)
        if len(self._times) > 2 * _KEEP:
            del self._times[:-_KEEP], self._states[:-_KEEP]

    def newest(self) -> TruthState:
        """Return the newest state."""
        return self._states[-1]

    def between(self, from_s: float, to_s: float) -> list[TruthState]:
        """Return the states in [from, to]."""
        low, high = (
            np.searchsorted(self._times, from_s),
            np.searchsorted(self._times, to_s, "right"),
        )
        return self._states[int(low) : int(high)]

    def body(self, times_s: Float) -> tuple[Float32, Float32]:
        """Return (N, 3) positions and (N, 4) quaternions (body in world) at (N,) times."""
        low, share = self._bracket(times_s)
        states, low = self._window(low)
        positions = np.array([state.position_w for state in states])
        quaternions = np.array([state.quaternion_wb for state in states])
        return _blend(positions, low, share), _blend_quaternions(quaternions, low, share)

    def camera(self, t_s: float) -> Float32:
        """Return the (4,) quaternion of the optical frame in the world at a time."""
        low, share = self._bracket(np.array([t_s]))
        states, low = self._window(low)
        quaternions = np.array([state.camera_quaternion_wc for state in states])
        return np.asarray(_blend_quaternions(quaternions, low, share)[0], np.float32)

    def _window(self, low: NDArray[np.intp]) -> tuple[list[TruthState], NDArray[np.intp]]:
        """Return the states that ``low`` refers to, and ``low`` counted from the first of them."""
        first, last = int(low.min()), int(low.max())
        states = self._states[first : last + 2]
        return states if len(states) > 1 else [*states, *states], low - first

    def _bracket(self, times_s: Float) -> tuple[NDArray[np.intp], Float]:
        times = np.asarray(self._times)
        if len(times) == 1:
            return np.zeros(len(times_s), np.intp), np.zeros(len(times_s))
        low = np.clip(np.searchsorted(times, times_s, "right") - 1, 0, len(times) - 2)
        share = (times_s - times[low]) / (times[low + 1] - times[low])
        return low, np.clip(share, 0.0, 1.0)


@njit(cache=True, nogil=True)
def _blend(values: Float, low: NDArray[np.intp], share: Float) -> Float32:  # pragma: no cover
    out = np.empty((len(low), 3), np.float32)
    for i in range(len(low)):
        k, s = low[i], share[i]
        for j in range(3):
            out[i, j] = values[k, j] + s * (values[k + 1, j] - values[k, j])
    return out


@njit(cache=True, nogil=True)
def _blend_quaternions(
    values: Float, low: NDArray[np.intp], share: Float
) -> Float32:  # pragma: no cover - compiled
    """Return normalised linear blends: over 20 ms they differ from the slerp by less than 1e-6."""
    out = np.empty((len(low), 4), np.float32)
    for i in range(len(low)):
        start, end, s = values[low[i]], values[low[i] + 1], share[i]
        dot = start[0] * end[0] + start[1] * end[1] + start[2] * end[2] + start[3] * end[3]
        near = -s if dot < 0.0 else s
        square = 0.0
        for j in range(4):
            mixed = (1.0 - s) * start[j] + near * end[j]
            out[i, j] = mixed
            square += mixed * mixed
        scale = 1.0 / np.sqrt(square)
        for j in range(4):
            out[i, j] *= scale
    return out


@njit(cache=True, nogil=True)
def rotate(quaternions: Float32, vectors: Float32) -> Float32:  # pragma: no cover - compiled
    """Return (N, 3) vectors rotated by (N, 4) unit quaternions (w, x, y, z)."""
    out = np.empty_like(vectors)
    for i in range(len(vectors)):
        w, x, y, z = quaternions[i]
        a, b, c = vectors[i]
        tx, ty, tz = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
        out[i, 0] = a + w * tx + y * tz - z * ty
        out[i, 1] = b + w * ty + z * tx - x * tz
        out[i, 2] = c + w * tz + x * ty - y * tx
    return out
