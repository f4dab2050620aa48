"""Recordings of a MID-360 as clouds: what the sensor saw, in its own frame."""

from __future__ import annotations

from pathlib import Path

from drivers.clouds.cloud_file import CloudFile
from drivers.livox.capture import read_capture
from drivers.livox.lvx2 import read_lvx2
from drivers.livox.recording import RecordedPacket, points_of
from perception.values import Float


def read_lvx2_cloud(path: Path) -> CloudFile:
    """Return the cloud of an LVX2 file; raise `BadFile`."""
    file = read_lvx2(path)
    return _cloud(file.packets, file.mounting, _notes(path, file.sensors, file.cut_off))


def read_capture_cloud(path: Path) -> CloudFile:
    """Return the cloud of a PCAP or PCAPNG file; raise `BadFile`."""
    file = read_capture(path)
    return _cloud(file.packets, None, _notes(path, file.sensors, file.cut_off))


def _cloud(
    packets: tuple[RecordedPacket, ...],
    mounting: tuple[Float, Float] | None,
    notes: tuple[str, ...],
) -> CloudFile:
    found = points_of(packets)
    return CloudFile(
        found.points_l.astype(float),
        time_s=found.time_s,
        arrival_s=found.arrival_s,
        trusted=found.tag == 0,
        mounting=mounting,
        in_sensor_frame=True,
        notes=notes,
    )


def _notes(path: Path, sensors: int, cut_off: bool) -> tuple[str, ...]:
    notes = []
    if cut_off:
        notes.append(f"{path}: ends within a packet; what stands before it is used")
    if sensors > 1:
        notes.append(f"{path}: holds {sensors} sensors; the one with the most packets is used")
    return tuple(notes)
