"""Named columns of a table of points, by the names that writers of clouds give them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.bad_file import BadFile
from drivers.clouds.cloud_file import CloudFile, float_step_m
from perception.values import Float

Column = NDArray[np.generic]


def cloud_of(path: Path, columns: Mapping[str, Column], viewpoint: Float | None) -> CloudFile:
    """Return the cloud of a table with columns x, y and z; `BadFile` where one is missing."""
    named = {name.lower(): column for name, column in columns.items()}
    missing = [name for name in "xyz" if name not in named]
    if missing:
        raise BadFile(
            path,
            f"has no column {' nor '.join(missing)} (it has {', '.join(columns) or 'none'})",
            "write the points as columns x, y and z",
        )
    xyz = [named[name] for name in "xyz"]
    if any(column.ndim != 1 or column.dtype.kind not in "fiu" for column in xyz):
        raise BadFile(path, "columns x, y and z are not one number a point", "write numbers")
    with np.errstate(invalid="ignore"):  # a signalling NaN is a point not measured, like any NaN
        points = np.stack([column.astype(np.float64) for column in xyz], axis=1)
    step = max(float_step_m(column) for column in xyz)
    return CloudFile(points, viewpoint, time_s=_seconds(named), step_m=step)


def _seconds(named: Mapping[str, Column]) -> Float | None:
    """Return the column of times, where its name says that it holds seconds."""
    column = named.get("time_s")
    return None if column is None or column.ndim != 1 else column.astype(np.float64)
