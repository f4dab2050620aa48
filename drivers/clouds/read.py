"""The reader of a cloud by the ending of its name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from drivers.bad_file import BadFile
from drivers.clouds.cloud_file import CloudFile
from drivers.clouds.livox_files import read_capture_cloud, read_lvx2_cloud
from drivers.clouds.npz import read_npz
from drivers.clouds.pcd import read_pcd
from drivers.clouds.ply import read_ply

READERS: Mapping[str, Callable[[Path], CloudFile]] = {
    ".npz": read_npz,
    ".pcd": read_pcd,
    ".ply": read_ply,
    ".lvx2": read_lvx2_cloud,
    ".pcap": read_capture_cloud,
    ".pcapng": read_capture_cloud,
}


def read_cloud(path: Path) -> CloudFile:
    """Return what a file of any known format holds; raise `BadFile`."""
    reader = READERS.get(path.suffix.lower())
    if reader is not None:
        return reader(path)
    if path.is_dir():
        raise BadFile(path, "is a folder", "name one file in it")
    known = ", ".join(READERS)
    wrong = f"its ending {path.suffix!r} is not known" if path.suffix else "has no ending"
    raise BadFile(path, wrong, f"convert it to one of {known}")
