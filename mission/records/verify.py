"""Are the files of a mission as they were stored? By the SHA-256 sums of its manifest."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection
from dataclasses import asdict, dataclass
from pathlib import Path

from mission.records.files import MANIFEST, PHOTOS

_LINE = re.compile(r"([0-9a-f]{64})  (.+)")


class NoManifest(ValueError):
    """The folder has no manifest, or one that cannot be read."""


@dataclass(frozen=True, slots=True)
class Checked:
    """What became of a mission's files; names are relative to its folder."""

    good: int
    changed: tuple[str, ...]
    missing: tuple[str, ...]
    unlisted: tuple[str, ...]
    """Photos that the manifest does not name."""

    def as_json(self) -> dict[str, object]:
        """Return the answer as plain values."""
        return asdict(self)


def check_manifest(folder: Path, only: Collection[str] | None = None) -> Checked:
    """Compare a mission's files with its manifest. Raises `NoManifest`.

    ``only``: look at files of these names; None: at all.
    """
    listed = _listed(folder)
    if only is not None:
        listed = {name: digest for name, digest in listed.items() if name in only}
    good, changed, missing = 0, [], []
    for name, digest in listed.items():
        path = folder / name
        if not path.is_file():
            missing.append(name)
        elif hashlib.sha256(path.read_bytes()).hexdigest() == digest:
            good += 1
        else:
            changed.append(name)
    photos = (folder / PHOTOS).glob("**/*.jpg")
    there = {path.relative_to(folder).as_posix() for path in photos}
    if only is not None:
        there &= set(only)
    return Checked(good, tuple(changed), tuple(missing), tuple(sorted(there - set(listed))))


def _listed(folder: Path) -> dict[str, str]:
    """Return the sums by name."""
    path = folder / MANIFEST
    try:
        lines = path.read_text("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise NoManifest(f"{folder} has no {MANIFEST} that can be read") from error
    sums: dict[str, str] = {}
    for number, line in enumerate(lines, 1):
        match = _LINE.fullmatch(line)
        if match is None or ".." in Path(match[2]).parts or Path(match[2]).is_absolute():
            raise NoManifest(f"{path}, line {number}: not a SHA-256 sum and a name")
        sums[match[2]] = match[1]
    return sums
