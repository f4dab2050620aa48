"""What a MID-360 makes of a true range: noise, fall-off, mixed pixels, fog. Pure.

Figures: 40 m at 10 % and 70 m at 80 % reflectivity, 2 cm at 10 m, 0.15 deg (data sheet); the range
noise sigma = hypot(3.4 mm, 0.73 mm/m r) / cos(incidence)^0.78 and the loss beyond 78 deg were
fitted to real units. Fog follows Beer and Lambert, both ways, and scatters back near the sensor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from perception.values import Bytes, Float32

Bools = NDArray[np.bool_]

#: Tag bits: 0-1 between near objects (glue), 2-3 rain, fog or dust; 0 is a trusted return.
TAG_MIXED = 0b0001
TAG_FOG = 0b1000

_RANGE_AT_TENTH_M = 40.0
_RANGE_EXPONENT = np.log(70 / 40) / np.log(8)
_RANGE_SOFTNESS = 0.03  # share of the range over which detection fades
_BLIND_M = 0.1
_GRAZING_RAD = np.deg2rad(78.0)
_ANGLE_SIGMA_RAD = np.deg2rad(0.08)
# A 0.25 deg beam against 1.3 deg between a line's rays: how often a step in range is cut by one.
_EDGE_SHARE = 0.2
_MIXING_M = (0.15, 2.0)  # nearer it is noise, farther the echoes are told apart
_MIXED_SEEN = 0.7  # share of mixed returns that the firmware marks
_LINES = 4


class Returns(NamedTuple):
    """What the sensor reports for N rays, in firing order."""

    ranges_m: Float32
    """(N,) metres along the reported direction; 0 where nothing came back."""
    returned: Bools
    """(N,)"""
    tag: Bytes
    """(N,) Livox confidence bits."""
    reflectivity: Bytes
    """(N,) 0-150: diffuse, 0-100 %."""


def measure(
    ranges_m: Float32,
    incidence_cos: Float32,
    reflectivity: Float32,
    rng: np.random.Generator,
    *,
    fog_extinction_per_m: float = 0.0,
) -> Returns:
    """Return what the sensor reports for true ranges.

    Args:
        ranges_m: (N,) true ranges in firing order, metres; inf or NaN where nothing was hit.
        incidence_cos: (N,) cosine between ray and surface normal (its sign is ignored).
        reflectivity: (N,) diffuse reflectivity of the surface, 0-1.
        rng: the sensor's own random stream.
        fog_extinction_per_m: 0 is clear air; 0.03 is fog of 130 m visibility.
    """
    true_m = np.asarray(ranges_m, np.float32)
    hit = np.isfinite(true_m) & (true_m > _BLIND_M)
    count = len(true_m)
    tag = np.zeros(count, np.uint8)
    out_m = np.zeros(count, np.float32)
    bright = np.zeros(count, np.uint8)

    # Most rays see sky: only the hits are worth computing.
    index = np.flatnonzero(hit)
    r_m = true_m[index]
    cos = np.clip(np.abs(np.asarray(incidence_cos, np.float32)[index]), 0.002, 1.0)
    rho = np.clip(np.asarray(reflectivity, np.float32)[index], 0.0, 1.0)

    seen = rng.random(len(index), np.float32) < _detection(r_m, cos, rho, fog_extinction_per_m)
    sigma_m = np.hypot(0.0034, 0.00073 * r_m) / np.maximum(cos, 0.02) ** 0.78
    measured_m = r_m + sigma_m * rng.standard_normal(len(index), np.float32)
    level = 150 * rho * cos * (1 + 0.05 * rng.standard_normal(len(index), np.float32))

    out_m[index] = np.where(seen, np.maximum(measured_m, _BLIND_M), 0)
    bright[index] = np.where(seen, np.clip(level, 1, 150), 0).astype(np.uint8)
    _mix_at_edges(true_m, hit, out_m, tag, rng)
    if fog_extinction_per_m > 0:
        _scatter_back(true_m, out_m, tag, bright, fog_extinction_per_m, rng)
    return Returns(out_m, out_m > 0, tag, bright)


def reported_directions(directions: Float32, rng: np.random.Generator) -> Float32:
    """Return (N, 3) directions as the sensor believes them, turned by its angular noise.

    Cast the rays along ``directions``, report the points along these.
    """
    noise = rng.standard_normal(directions.shape, np.float32)
    # What lies along the ray only changes the length, by less than 2e-6: it need not be removed.
    noise *= np.float32(_ANGLE_SIGMA_RAD)
    noise -= np.einsum("ij,ij->i", noise, directions)[:, None] * directions
    noise += directions
    return noise


def _detection(r_m: Float32, cos: Float32, rho: Float32, extinction_per_m: float) -> Float32:
    """Return the probability that an echo is strong enough (90 % at the data sheet's range)."""
    signal = np.maximum(rho * cos * np.exp(-2 * extinction_per_m * r_m), 1e-6)
    reach_m = _RANGE_AT_TENTH_M * (signal / 0.1) ** _RANGE_EXPONENT
    fade = (r_m / reach_m - 1) / _RANGE_SOFTNESS - 2.2
    chance = 1 / (1 + np.exp(np.clip(fade, -40, 40)))
    incidence = np.arccos(cos)
    grazing = np.clip((np.pi / 2 - incidence) / (np.pi / 2 - _GRAZING_RAD), 0, 1)
    detection: Float32 = (chance * grazing).astype(np.float32)
    return detection


def _mix_at_edges(
    true_m: Float32, hit: Bools, out_m: Float32, tag: Bytes, rng: np.random.Generator
) -> None:
    """Put some returns between two surfaces where a line steps from one to the other."""
    if len(true_m) <= _LINES:
        return
    both = np.flatnonzero(hit[:-_LINES] & hit[_LINES:])
    step_m = true_m[both + _LINES] - true_m[both]
    size_m = np.abs(step_m)
    at_edge = (size_m > _MIXING_M[0]) & (size_m < _MIXING_M[1])
    edge, step_m = both[at_edge], step_m[at_edge]
    cut = (rng.random(len(edge)) < _EDGE_SHARE) & (out_m[edge] > 0)
    edge, step_m = edge[cut], step_m[cut]
    out_m[edge] += step_m * rng.random(len(edge), np.float32)
    tag[edge[rng.random(len(edge)) < _MIXED_SEEN]] |= TAG_MIXED


def _scatter_back(
    true_m: Float32,
    out_m: Float32,
    tag: Bytes,
    bright: Bytes,
    extinction_per_m: float,
    rng: np.random.Generator,
) -> None:
    """Replace some returns, and some of no return, by echoes of the fog itself, near and dim."""
    chance = min(0.9, 1 - np.exp(-10 * extinction_per_m))
    index = np.flatnonzero(rng.random(len(true_m)) < chance)
    fog_m = (0.4 + rng.gamma(2.0, 1.2, len(index))).astype(np.float32)
    nearer = ~(fog_m >= true_m[index])  # also where true_m is NaN
    index, fog_m = index[nearer], fog_m[nearer]
    out_m[index] = fog_m
    bright[index] = rng.integers(1, 12, len(index), dtype=np.uint8)
    tag[index] = np.where(rng.random(len(index)) < 0.6, TAG_FOG, 0).astype(np.uint8)
