"""A file that cannot be used, told in one sentence; and the bytes of one that can be opened."""

from __future__ import annotations

from pathlib import Path


class BadFile(ValueError):
    """A file cannot be used; the text names it, what is wrong, and what to do."""

    def __init__(self, path: Path, wrong: str, remedy: str) -> None:
        super().__init__(f"{path}: {wrong}; {remedy}")


def read_bytes(path: Path) -> bytes:
    """Return a file's bytes; raise `BadFile` where there is none, or nothing in it."""
    if not path.exists():
        raise BadFile(path, "no such file", "check the path")
    if path.is_dir():
        raise BadFile(path, "is a folder", "name a file in it")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadFile(path, f"cannot be read ({error.strerror})", "check its permissions") from None
    if not data:
        raise BadFile(path, "is empty", "copy or record it again")
    return data
