"""Point Cloud Library files (PCD 0.7): ascii, binary and binary_compressed."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.bad_file import BadFile, read_bytes
from drivers.clouds.cloud_file import CloudFile
from drivers.clouds.columns import Column, cloud_of
from drivers.clouds.lzf import decompress
from perception.values import Float

_AGAIN = "copy or save it again"
_TYPES = {"F": "f", "I": "i", "U": "u"}
#: More than any scan holds; a damaged header must not ask for all the memory.
_MOST_POINTS = 500_000_000


@dataclass(frozen=True, slots=True, eq=False)
class _Header:
    dtype: np.dtype[np.void]
    names: tuple[str, ...]
    points: int
    viewpoint: Float | None
    data: str


def read_pcd(path: Path) -> CloudFile:
    """Return the cloud of a PCD file; raise `BadFile`.

    A VIEWPOINT other than the default (0 0 0) tells where the sensor stood; points are taken as
    they are stored.
    """
    content = read_bytes(path)
    header, body = _header(path, content)
    if header.data == "ascii":
        columns = _ascii(path, header, body)
    elif header.data == "binary":
        columns = _binary(path, header, body)
    else:
        columns = _compressed(path, header, body)
    return cloud_of(path, columns, header.viewpoint)


def _header(path: Path, content: bytes) -> tuple[_Header, bytes]:
    entries: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in entries:
        end = content.find(b"\n", at)
        if end < 0 or end - at > 4096:
            raise BadFile(path, "has no DATA line and so is no PCD file", _AGAIN)
        words = content[at:end].decode("ascii", "replace").split()
        at = end + 1
        if words and not words[0].startswith("#"):
            entries[words[0].upper()] = words[1:]
    try:
        return _parsed(entries), content[at:]
    except (KeyError, ValueError, IndexError) as error:
        what = error.args[0] if error.args else error
        raise BadFile(path, f"its PCD header cannot be used ({what})", _AGAIN) from None


def _parsed(entries: dict[str, list[str]]) -> _Header:
    fields, sizes, types = entries["FIELDS"], entries["SIZE"], entries["TYPE"]
    counts = entries.get("COUNT", ["1"] * len(fields))
    parts: list[tuple[str, str, tuple[int, ...]]] = []
    names: list[str] = []
    for k, (name, size, kind, count) in enumerate(zip(fields, sizes, types, counts, strict=True)):
        # Padding is called "_", as often as it comes.
        unique = f"_{k}" if name in names or name == "_" else name
        names.append(unique)
        shape = () if count == "1" else (int(count),)
        parts.append((unique, f"<{_TYPES[kind.upper()]}{int(size)}", shape))
    width, height = int(entries["WIDTH"][0]), int(entries["HEIGHT"][0])
    points = int(entries.get("POINTS", [str(width * height)])[0])
    if not 0 <= points <= _MOST_POINTS:
        raise ValueError(f"POINTS {points}")
    place = [float(word) for word in entries.get("VIEWPOINT", ["0", "0", "0"])[:3]]
    data = entries["DATA"][0].lower()
    if data not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(f"DATA {data}")
    viewpoint = np.array(place) if any(place) else None
    return _Header(np.dtype(parts), tuple(names), points, viewpoint, data)


def _ascii(path: Path, header: _Header, body: bytes) -> dict[str, Column]:
    width = sum(int(np.prod(header.dtype[name].shape)) for name in header.names)
    words = body.split()
    if len(words) != header.points * width:
        whole = len(words) // width
        raise BadFile(path, f"announces {header.points} points and holds {whole}", _AGAIN)
    try:
        table = np.array(words, dtype="S32").astype(np.float64).reshape(header.points, width)
    except ValueError as error:
        raise BadFile(path, f"holds words that are no numbers ({error})", _AGAIN) from None
    columns: dict[str, Column] = {}
    at = 0
    for name in header.names:
        many = int(np.prod(header.dtype[name].shape))
        columns[name] = table[:, at] if many == 1 else table[:, at : at + many]
        at += many
    return columns


def _binary(path: Path, header: _Header, body: bytes) -> dict[str, Column]:
    needed = header.points * header.dtype.itemsize
    if len(body) < needed:
        whole = len(body) // header.dtype.itemsize
        raise BadFile(path, f"announces {header.points} points and holds {whole}", _AGAIN)
    table = np.frombuffer(body, header.dtype, header.points)
    return {name: table[name] for name in header.names}


def _compressed(path: Path, header: _Header, body: bytes) -> dict[str, Column]:
    needed = header.points * header.dtype.itemsize
    packed_size, size = struct.unpack_from("<II", body) if len(body) >= 8 else (0, -1)
    unpacked = None
    if size == needed and len(body) >= 8 + packed_size:
        unpacked = decompress(body[8 : 8 + packed_size], size)
    if unpacked is None:
        raise BadFile(path, "its compressed points are cut off or damaged", _AGAIN)
    columns: dict[str, Column] = {}
    at = 0
    # One column after the other, not point by point.
    for name in header.names:
        dtype = header.dtype[name]
        part = np.frombuffer(unpacked, dtype.base, header.points * int(np.prod(dtype.shape)), at)
        columns[name] = part.reshape(header.points, *dtype.shape)
        at += part.nbytes
    return columns
