"""A recorded cloud as it is given to `cloud_estimate`, and what disqualifies one beforehand.

What cannot be a rotor in metres is said before any fit: a fit would refuse it too, but not say
what to do about it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from perception.values import Float

#: Fewer returns than this hold no rotor.
MIN_POINTS = 60
#: No scanner sees farther in metres, and no rotor is smaller.
MAX_SPAN_M, MIN_SPAN_M = 5000.0, 5.0
#: From here on a place is one in a national grid, and is reckoned from a nearer one.
GRID_M = 2000.0
#: Coarser steps than this blur a blade's edge.
MAX_STEP_M = 0.03


class UnusableCloud(ValueError):
    """The cloud holds nothing that could be a rotor in metres; the text says why and what to do."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedCloud:
    """Returns of one or more looks at a turbine: world, z up, metres."""

    points_w: Float
    """(N, 3)"""
    origins_w: Float
    """(N, 3) or (3,) where the sensor stood."""
    time_s: Float | None = None
    """(N,) when each point was measured; None: as one look."""
    step_m: float = 0.0
    """By how much neighbouring values of the file differ at its largest coordinate (float32)."""


@dataclass(frozen=True, slots=True, eq=False)
class NearCloud:
    """A cloud reckoned from a place near it, so that small differences keep their digits."""

    cloud: RecordedCloud
    shift_w: Float
    """(3,) what was taken off."""
    dropped: int
    """Points that were not finite, or nothing at all."""


def checked(cloud: RecordedCloud) -> NearCloud:
    """Return the finite points, reckoned from near; raise `UnusableCloud` where there is no hope.

    Left out are rows with NaN or infinity and rows that are exactly zero (no return).
    """
    points = np.asarray(cloud.points_w, np.float64).reshape(-1, 3)
    if not len(points):
        raise UnusableCloud("holds no points; record again")
    origins = np.broadcast_to(np.asarray(cloud.origins_w, np.float64), points.shape)
    keep = np.isfinite(points).all(axis=1) & (points != 0).any(axis=1)
    keep &= np.isfinite(origins).all(axis=1)
    if cloud.time_s is not None:
        keep &= np.isfinite(cloud.time_s)
    kept = int(keep.sum())
    if kept < MIN_POINTS:
        raise UnusableCloud(
            f"holds {kept} finite points of {len(points)}, and {MIN_POINTS} are needed; "
            "record longer, or nearer to the rotor"
        )
    points, origins = points[keep], origins[keep]
    _check_size(points, origins)
    if cloud.step_m > MAX_STEP_M:
        raise UnusableCloud(
            f"its coordinates are 32-bit numbers so large that they step by {cloud.step_m:.2f} m; "
            "subtract an offset (the tower's foot) before the cloud is stored"
        )
    middle = np.median(points, axis=0)
    shift = np.where(np.abs(middle) > GRID_M, np.round(middle, -2), 0.0)
    near = replace(
        cloud,
        points_w=points - shift,
        origins_w=origins - shift,
        time_s=None if cloud.time_s is None else cloud.time_s[keep],
    )
    return NearCloud(near, shift, len(keep) - kept)


def _check_size(points: Float, origins: Float) -> None:
    low, high = np.quantile(points, [0.02, 0.98], axis=0)
    span = float((high - low).max())
    if span > MAX_SPAN_M:
        raise UnusableCloud(
            f"spans {span:.0f} m, so its coordinates are not metres (millimetres?); "
            "divide them by 1000"
        )
    if span < MIN_SPAN_M:
        raise UnusableCloud(
            f"spans {span:.2f} m, too little for a rotor; coordinates must be metres, "
            "and the cloud must show all three blades"
        )
    away = float(np.median(np.linalg.norm(points - origins, axis=1)))
    if away > MAX_SPAN_M:
        raise UnusableCloud(
            f"lies {away:.0f} m from where the sensor is said to have stood; give the viewpoint "
            "in the cloud's own frame"
        )
