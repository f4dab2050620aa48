"""Files of a mission folder: names, and writing that never leaves half a file."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

PHOTOS = "photos"
EVENTS = "events.jsonl"
MISSION = "mission.json"
REPORT = "report.html"
COMPARISON = "comparison.html"
CONFIG = "config.toml"
RECORDING = "recording.mcap"
LINK = "link.tlog"
GEOJSON = "photos.geojson"
MANIFEST = "SHA256SUMS"


def write_whole(path: Path, data: bytes) -> None:
    """Write a file so that it is there whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    with part.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def new_recording(folder: Path, name: str = RECORDING) -> Path:
    """Return where to record: beside what an earlier process has recorded of the same mission."""
    path, count = folder / name, 1
    while path.is_file() and path.stat().st_size > 0:
        count += 1
        path = folder / f"{Path(name).stem}-{count}{Path(name).suffix}"
    return path


def photo_name(turbine: str, blade: str, side: str, metre: float, utc: str) -> str:
    """Return `<turbine>_<blade>_<side>_<metre>_<UTC>.jpg`; UTC without colons."""
    compact = utc.replace(":", "").replace("-", "")
    return f"{turbine}_{blade}_{side}_{metre:05.1f}_{compact}.jpg"


def manifest(folder: Path, paths: Iterable[Path]) -> str:
    """Return the SHA-256 sums of files, as `sha256sum -c` reads them."""
    lines = []
    for path in sorted(paths):
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        lines.append(f"{digest}  {path.relative_to(folder)}\n")
    return "".join(lines)
