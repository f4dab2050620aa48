"""Clouds as NumPy archives: `points` (N, 3) metres, optional `time_s`, `viewpoint`."""

from __future__ import annotations

import io
import struct
import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.bad_file import BadFile, read_bytes
from drivers.clouds.cloud_file import CloudFile, float_step_m
from perception.values import Float

_KEYS = "points (N, 3), and if known time_s (N,) and viewpoint (3,) or (N, 3)"

#: What the libraries below say of a damaged archive, by the place of the damage.
_DAMAGE = (
    ValueError, OSError, EOFError, KeyError, AttributeError, TypeError, SyntaxError, MemoryError,
    RuntimeError, OverflowError, struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


def read_npz(path: Path) -> CloudFile:
    """Return the cloud of an archive; raise `BadFile`."""
    arrays = _arrays(path)
    points = arrays.get("points")
    if points is None:
        raise BadFile(
            path, f"has no array 'points' (it has {', '.join(arrays) or 'none'})", f"write {_KEYS}"
        )
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise BadFile(
            path,
            f"'points' is {points.dtype} of shape {points.shape}",
            "it must be numbers of shape (N, 3)",
        )
    count = len(points)
    viewpoint = _fitting(path, arrays, "viewpoint", ((3,), (count, 3)))
    time_s = _fitting(path, arrays, "time_s", ((count,),))
    return CloudFile(
        points.astype(np.float64), viewpoint, time_s=time_s, step_m=float_step_m(points)
    )


def _arrays(path: Path) -> dict[str, NDArray[np.generic]]:
    content = read_bytes(path)
    if content.startswith(b"\x93NUMPY"):
        raise BadFile(path, "is a bare array (NPY)", f"save with np.savez: {_KEYS}")
    damaged = "is no whole NPZ archive (cut off, or another format)"
    if not content.startswith(b"PK"):
        raise BadFile(path, damaged, "copy or save it again")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            return {name: np.asarray(archive[name]) for name in archive.files}
    except _DAMAGE as error:
        if "allow_pickle" in str(error):
            raise BadFile(
                path, "holds Python objects, which are not read", f"save plain arrays: {_KEYS}"
            ) from None
        raise BadFile(path, damaged, "copy or save it again") from None


def _fitting(
    path: Path,
    arrays: dict[str, NDArray[np.generic]],
    name: str,
    shapes: tuple[tuple[int, ...], ...],
) -> Float | None:
    array = arrays.get(name)
    if array is None:
        return None
    if array.shape not in shapes or array.dtype.kind not in "fiu":
        wanted = " or ".join(str(shape) for shape in shapes)
        raise BadFile(
            path, f"{name!r} is {array.dtype} of shape {array.shape}", f"it must be {wanted}"
        )
    return np.asarray(array, np.float64)
