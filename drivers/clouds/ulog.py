"""Poses out of a PX4 log (ULog 1): position and attitude as the autopilot estimated them.

Of the file only what is needed is read: format definitions, subscriptions and data of
`vehicle_local_position`, `vehicle_attitude` and `sensor_gps` (which says how its clock, from boot,
stands to UTC). Layout: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.bad_file import BadFile, read_bytes
from drivers.frames import swap_attitude, swap_enu_ned
from perception.values import Float, Pose

_MAGIC = b"ULog\x01\x12\x35"
_HEADER_BYTES = 16
_SIZES = {
    "int8_t": 1, "uint8_t": 1, "bool": 1, "char": 1, "int16_t": 2, "uint16_t": 2, "int32_t": 4,
    "uint32_t": 4, "float": 4, "int64_t": 8, "uint64_t": 8, "double": 8,
}  # fmt: skip
_CODES = {"uint64_t": "Q", "float": "f", "double": "d", "uint8_t": "B", "bool": "B"}
_POSITION, _ATTITUDE, _GPS = "vehicle_local_position", "vehicle_attitude", "sensor_gps"
_OLD_GPS = "vehicle_gps_position"
_TOPICS = frozenset({_POSITION, _ATTITUDE, _GPS, _OLD_GPS})
#: An attitude farther in time from a position than this is none of it.
_MOST_APART_S = 0.2
_REMEDY = "copy the log again from the autopilot, or convert it to a text of poses"


@dataclass(frozen=True, slots=True)
class _Field:
    """Where a field lies in a message, and as what."""

    offset: int
    kind: str
    count: int


def read_ulog_poses(path: Path) -> tuple[Pose, ...]:
    """Return the poses (FLU body in ENU, metres) in rising time; raise `BadFile`.

    Seconds of UTC where the log knows them by GPS, else since boot. A log that is cut short is
    read as far as it goes.
    """
    data = read_bytes(path)
    if not data.startswith(_MAGIC):
        raise BadFile(path, "is not a PX4 log (ULog)", _REMEDY)
    formats: dict[str, str] = {}
    named: dict[int, str] = {}
    rows: dict[str, list[bytes]] = {topic: [] for topic in _TOPICS}
    for kind, body in _messages(data):
        if kind == b"F":
            name, _, fields = body.decode("ascii", "replace").partition(":")
            formats[name] = fields
        elif kind == b"A" and len(body) > 3:
            multi, number = struct.unpack_from("<BH", body)
            name = body[3:].decode("ascii", "replace")
            if name in _TOPICS and multi == 0:
                named[number] = name
        elif kind == b"D" and len(body) > 2:
            topic = named.get(struct.unpack_from("<H", body)[0])
            if topic is not None:
                rows[topic].append(body[2:])
    return _poses(path, formats, rows)


def _messages(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = _HEADER_BYTES
    while at + 3 <= len(data):
        (size,) = struct.unpack_from("<H", data, at)
        if at + 3 + size > len(data):
            return
        yield data[at + 2 : at + 3], data[at + 3 : at + 3 + size]
        at += 3 + size


def _fields(text: str) -> dict[str, _Field]:
    """Return the plain fields of a format definition; those behind a nested one are not told."""
    found: dict[str, _Field] = {}
    offset = 0
    for word in text.split(";"):
        kind, _, name = word.strip().partition(" ")
        kind, _, many = kind.partition("[")
        count = int(many.rstrip("]")) if many.rstrip("]").isdigit() else 1
        if kind not in _SIZES:
            break
        found[name] = _Field(offset, kind, count)
        offset += _SIZES[kind] * count
    return found


class _Table:
    """The data of one topic as columns."""

    def __init__(self, path: Path, topic: str, text: str, rows: list[bytes]) -> None:
        self._path, self._topic = path, topic
        self._fields = _fields(text)
        self._rows = rows

    def column(self, name: str) -> Float:
        """Return (N,) or (N, count) values; raise `BadFile` where there is no such field."""
        field = self._fields.get(name)
        if field is None or field.kind not in _CODES:
            raise BadFile(self._path, f"{self._topic} has no field {name}", _REMEDY)
        code = struct.Struct(f"<{field.count}{_CODES[field.kind]}")
        whole = [row for row in self._rows if len(row) >= field.offset + code.size]
        values = np.array([code.unpack_from(row, field.offset) for row in whole], np.float64)
        values = values.reshape(len(whole), field.count)
        return values[:, 0] if field.count == 1 else values


def _poses(path: Path, formats: dict[str, str], rows: dict[str, list[bytes]]) -> tuple[Pose, ...]:
    for topic in (_POSITION, _ATTITUDE):
        if not rows[topic] or topic not in formats:
            raise BadFile(path, f"holds no {topic}", "log it (SDLOG_PROFILE), or give other poses")
    place = _Table(path, _POSITION, formats[_POSITION], rows[_POSITION])
    turn = _Table(path, _ATTITUDE, formats[_ATTITUDE], rows[_ATTITUDE])
    place_s, turn_s = place.column("timestamp") * 1e-6, turn.column("timestamp") * 1e-6
    ned = np.column_stack([place.column(axis) for axis in ("x", "y", "z")])
    speed = np.column_stack([place.column(axis) for axis in ("vx", "vy", "vz")])
    quaternions = turn.column("q")
    count = min(len(place_s), len(ned), len(speed))
    if quaternions.ndim != 2 or quaternions.shape[1] != 4 or not count:
        raise BadFile(path, f"its {_ATTITUDE} holds no quaternions", _REMEDY)
    utc_s = _utc_less_boot_s(path, formats, rows)
    after = np.clip(np.searchsorted(turn_s, place_s), 1, max(len(turn_s) - 1, 1))
    before_s, after_s = turn_s[after - 1], turn_s[np.minimum(after, len(turn_s) - 1)]
    nearest = np.where(place_s - before_s <= after_s - place_s, after - 1, after)
    nearest = np.minimum(nearest, len(quaternions) - 1)
    poses: dict[float, Pose] = {}
    for index in range(count):
        quaternion = quaternions[nearest[index]]
        values = (*ned[index], *speed[index], *quaternion)
        apart_s = abs(place_s[index] - turn_s[nearest[index]])
        if apart_s > _MOST_APART_S or not np.isfinite(values).all():
            continue
        turned = np.array(swap_attitude(_four(quaternion)))
        size = float(np.linalg.norm(turned))
        if abs(size - 1.0) > 0.05:
            continue
        stamp_s = float(place_s[index] + utc_s)
        poses[stamp_s] = Pose(
            stamp_s,
            np.array(swap_enu_ned(_three(ned[index]))),
            turned / size,
            np.array(swap_enu_ned(_three(speed[index]))),
        )
    if not poses:
        raise BadFile(path, "holds no position with an attitude", _REMEDY)
    return tuple(poses[stamp_s] for stamp_s in sorted(poses))


def _utc_less_boot_s(path: Path, formats: dict[str, str], rows: dict[str, list[bytes]]) -> float:
    """Return what to add to times since boot to get UTC; 0 where the log does not know."""
    for topic in (_GPS, _OLD_GPS):
        if rows[topic] and topic in formats:
            table = _Table(path, topic, formats[topic], rows[topic])
            boot_us, utc_us = table.column("timestamp"), table.column("time_utc_usec")
            known = utc_us > 0
            if known.any():
                return float(np.median(utc_us[known] - boot_us[known])) * 1e-6
    return 0.0


def _three(values: Float) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def _four(values: Float) -> tuple[float, float, float, float]:
    return float(values[0]), float(values[1]), float(values[2]), float(values[3])
