"""Where a MID-360 looks, ray by ray: its non-repetitive pattern of two rotors and four lasers.

A fast rotor carries the four lasers round the azimuth, a slow one nods the beam between -7 and 52
deg of elevation, on a small circle, so that azimuth sways with it. Their rates (fitted to a real
unit) have no common period: the pattern closes nowhere, and in 0.5 s it covers most of the field
of view. The shape is a few harmonics fitted to a published table of rays.

Rays come in firing order, 200 000 a second, line = index % 4, as the sensor packs them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.values import Float, Float32

RAYS_PER_S = 200_000
LINES = 4
MIN_ELEVATION_RAD = float(np.deg2rad(-7.0))
MAX_ELEVATION_RAD = float(np.deg2rad(52.0))

_FAST_HZ = 181.083
_SLOW_HZ = 9.8994
# Elevation is constant + sum of c_k cos(k slow phase); azimuth sways by sum of s_k sin(k slow).
_ELEVATION_MEAN = np.float32(np.deg2rad(20.45))
_ELEVATION_COS = np.deg2rad([24.35, 1.13, 2.30]).astype(np.float32)
_AZIMUTH_SIN = np.deg2rad([27.5, 1.9, 2.4]).astype(np.float32)
# The lasers stand in a row that turns with the fast rotor.
_LASER_STEP_RAD = np.float32(np.deg2rad(0.92))
_LASER_TURN_RAD = np.float32(np.deg2rad(60.0))


def rays(t0_s: float, count: int) -> tuple[Float32, Float]:
    """Return the directions in which the sensor fires from ``t0_s`` on, and when.

    Args:
        t0_s: sensor time of the first ray, in seconds; the same time gives the same rays.
        count: rays wanted; 20 000 are 0.1 s.

    Returns:
        ``directions``: (N, 3) float32 unit vectors, sensor FLU; ``offsets_s``: (N,) float64,
        seconds after ``t0_s``.
    """
    offsets_s = np.arange(count) / RAYS_PER_S
    # By the ray's number, so that the line does not depend on where a batch is cut.
    first = round(t0_s * RAYS_PER_S)
    slow = _phase(t0_s, offsets_s, _SLOW_HZ)
    fast = _phase(t0_s, offsets_s, _FAST_HZ)

    cos, sin = np.cos(slow), np.sin(slow)
    cos_2, sin_2 = 2 * cos * cos - 1, 2 * sin * cos
    cos_3, sin_3 = cos_2 * cos - sin_2 * sin, sin_2 * cos + cos_2 * sin
    elevation = _ELEVATION_MEAN + (
        _ELEVATION_COS[0] * cos + _ELEVATION_COS[1] * cos_2 + _ELEVATION_COS[2] * cos_3
    )
    azimuth = (_AZIMUTH_SIN[0] * sin + _AZIMUTH_SIN[1] * sin_2 + _AZIMUTH_SIN[2] * sin_3) - fast

    line = (first + np.arange(count)) % LINES
    row = ((2 * line - (LINES - 1)) * _LASER_STEP_RAD).astype(np.float32)
    elevation = np.clip(
        elevation + row * np.cos(fast - _LASER_TURN_RAD), MIN_ELEVATION_RAD, MAX_ELEVATION_RAD
    )
    azimuth -= row * np.sin(fast - _LASER_TURN_RAD)
    return _unit_vectors(azimuth, elevation), offsets_s


def _phase(t0_s: float, offsets_s: Float, rate_hz: float) -> Float32:
    """Return the rotor's phase in [0, ~2 pi): reduced in float64, so hours do not blur it."""
    turns = (t0_s * rate_hz) % 1.0 + offsets_s * rate_hz
    turns -= np.floor(turns)
    return (turns * (2 * np.pi)).astype(np.float32)


def _unit_vectors(azimuth: NDArray[np.float32], elevation: NDArray[np.float32]) -> Float32:
    directions = np.empty((len(azimuth), 3), np.float32)
    level = np.cos(elevation)
    directions[:, 0] = level * np.cos(azimuth)
    directions[:, 1] = level * np.sin(azimuth)
    directions[:, 2] = np.sin(elevation)
    return directions
