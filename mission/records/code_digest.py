"""Which code flew: a digest of the sources that decide, so that a replay knows its own."""

from __future__ import annotations

import hashlib
from importlib.resources import files
from importlib.resources.abc import Traversable

#: What computes commands and estimates; drivers and pages are not among it.
_PACKAGES = ("config", "perception", "mission.flight")


def code_digest() -> str:
    """Return 16 hexadecimal digits of the SHA-256 of all deciding sources, in a fixed order."""
    digest = hashlib.sha256()
    for package in _PACKAGES:
        _add(digest, files(package), package)
    return digest.hexdigest()[:16]


def _add(digest: hashlib._Hash, place: Traversable, name: str) -> None:
    for one in sorted(place.iterdir(), key=lambda entry: entry.name):
        if one.is_dir():
            if not one.name.startswith("__"):
                _add(digest, one, f"{name}/{one.name}")
        elif one.name.endswith((".py", ".toml")):
            digest.update(f"{name}/{one.name}".encode())
            digest.update(one.read_bytes())
