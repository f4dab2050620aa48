"""Poses of a recording: TUM (`t_s x y z qx qy qz qw`), CSV with those names, or a PX4 log.

World from body, metres, z up; the body is forward, left, up.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drivers.bad_file import BadFile, read_bytes
from drivers.clouds.ulog import read_ulog_poses
from perception.values import Float, Pose

COLUMNS = ("t_s", "x", "y", "z", "qx", "qy", "qz", "qw")
_ALSO = {"t": "t_s", "time": "t_s", "timestamp": "t_s", "stamp": "t_s", "time_s": "t_s"}
_REMEDY = f"each line must be {' '.join(COLUMNS)}, world from body (TUM), or CSV with these names"


def read_poses(path: Path) -> tuple[Pose, ...]:
    """Return the poses in rising time; raise `BadFile`. Velocities are those between them.

    A file whose name ends in `.ulg` is a PX4 log.
    """
    if path.suffix.lower() == ".ulg":
        return read_ulog_poses(path)
    rows: list[list[float]] = []
    order = list(COLUMNS)
    text = read_bytes(path).decode("utf-8", "replace")
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split("#")[0].replace(",", " ").replace(";", " ").split()
        if not words:
            continue
        try:
            values = [float(word) for word in words]
        except ValueError:
            if rows:
                raise BadFile(path, f"line {number} holds words, not numbers", _REMEDY) from None
            order = _named(path, words)
            continue
        if len(values) != len(order):
            raise BadFile(
                path, f"line {number} has {len(values)} columns, not {len(order)}", _REMEDY
            )
        rows.append([values[order.index(name)] for name in COLUMNS])
    if not rows:
        raise BadFile(path, "holds no poses", _REMEDY)
    return _poses(path, np.array(rows, np.float64))


def _named(path: Path, words: list[str]) -> list[str]:
    names = [_ALSO.get(word.lower().strip('"'), word.lower().strip('"')) for word in words]
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        raise BadFile(path, f"has no column {', '.join(missing)}", _REMEDY)
    return names


def _poses(path: Path, table: Float) -> tuple[Pose, ...]:
    bad = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if len(bad):
        raise BadFile(path, f"pose {bad[0] + 1} is not finite", "leave such poses out")
    size = np.linalg.norm(table[:, 4:], axis=1)
    wrong = np.flatnonzero(np.abs(size - 1.0) > 0.05)
    if len(wrong):
        raise BadFile(
            path,
            f"the quaternion of pose {wrong[0] + 1} has the length {size[wrong[0]]:.2f}, not 1",
            _REMEDY,
        )
    table = table[np.unique(table[:, 0], return_index=True)[1]]
    times, places = table[:, 0], table[:, 1:4]
    speeds = np.gradient(places, times, axis=0) if len(table) > 1 else np.zeros((1, 3))
    return tuple(
        Pose(float(t), place, np.roll(q, 1) / np.linalg.norm(q), speed)
        for t, place, q, speed in zip(times, places, table[:, 4:], speeds, strict=True)
    )
