"""Stanford polygon files (PLY 1.0): ascii and binary of both byte orders; vertices only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.bad_file import BadFile, read_bytes
from drivers.clouds.cloud_file import CloudFile
from drivers.clouds.columns import Column, cloud_of

_AGAIN = "copy or save it again"
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
_MOST_POINTS = 500_000_000


@dataclass(frozen=True, slots=True, eq=False)
class _Header:
    form: str
    dtype: np.dtype[np.void]
    points: int


def read_ply(path: Path) -> CloudFile:
    """Return the vertices of a PLY file; raise `BadFile`. The format knows no viewpoint."""
    content = read_bytes(path)
    header, body = _header(path, content)
    names = header.dtype.names or ()
    if header.form == "ascii":
        lines = body.split(b"\n", header.points)
        words = b" ".join(lines[: header.points]).split()
        if len(words) != header.points * len(names):
            whole = len(words) // max(len(names), 1)
            raise BadFile(path, f"announces {header.points} points and holds {whole}", _AGAIN)
        try:
            table = np.array(words, "S32").astype(np.float64).reshape(header.points, len(names))
        except ValueError as error:
            raise BadFile(path, f"holds words that are no numbers ({error})", _AGAIN) from None
        columns: dict[str, Column] = {name: table[:, k] for k, name in enumerate(names)}
    else:
        if len(body) < header.points * header.dtype.itemsize:
            whole = len(body) // max(header.dtype.itemsize, 1)
            raise BadFile(path, f"announces {header.points} points and holds {whole}", _AGAIN)
        stored = np.frombuffer(body, header.dtype, header.points)
        columns = {name: stored[name] for name in names}
    return cloud_of(path, columns, None)


def _header(path: Path, content: bytes) -> tuple[_Header, bytes]:
    end = content.find(b"end_header")
    newline = content.find(b"\n", end)
    if not content.startswith(b"ply") or end < 0 or newline < 0:
        raise BadFile(path, "has no PLY header", _AGAIN)
    form, points, vertices_first = "", -1, True
    # A format that is not known has no byte order: a KeyError below names it.
    element = ""
    properties: list[tuple[str, str]] = []
    try:
        for line in content[:end].decode("ascii", "replace").splitlines():
            words = line.split()
            if words[:1] == ["format"]:
                form = words[1]
            elif words[:1] == ["element"]:
                vertices_first = vertices_first and (bool(element) or words[1] == "vertex")
                element = words[1]
                points = int(words[2]) if element == "vertex" else points
            elif words[:1] == ["property"] and element == "vertex":
                properties.append((words[-1], _ORDERS[form] + _TYPES[words[1]]))
        dtype = np.dtype(properties)
    except (KeyError, ValueError, IndexError) as error:
        what = error.args[0] if error.args else error
        raise BadFile(path, f"its PLY header cannot be used ({what})", _AGAIN) from None
    if not vertices_first or not 0 <= points <= _MOST_POINTS:
        raise BadFile(path, "does not begin with vertices", "save the points alone")
    return _Header(form, dtype, points), content[newline + 1 :]
