"""Which parts of a recording show the rotor from one place: the looks that are fitted.

A fit takes the sensor as standing still. A recording of a flight is cut into windows of time (of
place, where no time is known), and those that show the most round the hub are used.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from perception.recorded_cloud import RecordedCloud
from perception.values import Float

MOST = 5
STILL_M = 2.0
"""A look during which the sensor moved farther shows a blurred rotor."""
MARGIN_M = 8.0
"""Round the rotor's radius: how wrong a prior hub may be."""


def looks(
    cloud: RecordedCloud, hub_w: Float | None, radius_m: float, window_s: float
) -> Iterator[RecordedCloud]:
    """Yield up to five looks, the fullest first; only what lies round the hub, where that is known.

    ``hub_w``: (3,) prior hub; ``radius_m``: of the rotor; ``window_s``: time that one look takes.
    """
    origins = np.broadcast_to(cloud.origins_w, cloud.points_w.shape)
    wanted = np.ones(len(cloud.points_w), np.bool_)
    if hub_w is not None:
        wanted = np.linalg.norm(cloud.points_w - hub_w, axis=1) < radius_m + MARGIN_M
    window = _windows(origins, cloud.time_s, window_s)
    if window is None:
        yield replace(cloud, points_w=cloud.points_w[wanted], origins_w=origins[wanted])
        return
    shown = [(_worth(origins, window == k, wanted), int(k)) for k in np.unique(window)]
    for worth, k in sorted(shown, reverse=True)[:MOST]:
        if worth > 0:
            here = wanted & (window == k)
            yield replace(cloud, points_w=cloud.points_w[here], origins_w=origins[here])


def _windows(origins: Float, time_s: Float | None, window_s: float) -> NDArray[np.int64] | None:
    """Return the window (N,) of each point, None where all is one look."""
    if time_s is not None:
        if float(np.ptp(time_s)) < 1.5 * window_s:
            return None
        return np.asarray((time_s - time_s.min()) / window_s, np.int64)
    if float(np.ptp(origins, axis=0).max()) < STILL_M:
        return None
    cell = np.floor(origins / STILL_M).astype(np.int64)
    return np.asarray(np.unique(cell, axis=0, return_inverse=True)[1], np.int64).reshape(-1)


def _worth(origins: Float, here: NDArray[np.bool_], wanted: NDArray[np.bool_]) -> float:
    """Return how much of the rotor's surroundings a window shows, less where the sensor moved."""
    moved = float(np.ptp(origins[here], axis=0).max())
    return float((here & wanted).sum()) * (1.0 if moved < STILL_M else 0.1)
