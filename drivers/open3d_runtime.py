"""Open3D, loadable where the system has no libusb: the wheel brings it."""

from __future__ import annotations

import ctypes
import importlib
import importlib.util
from functools import lru_cache
from types import ModuleType


class Open3dUnavailable(RuntimeError):
    """Open3D cannot be loaded here; the text says what to install."""


#: Libraries that Open3D links and a bare Debian or Ubuntu lacks, with their packages.
DEBIAN_PACKAGES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libgomp.so.1": "libgomp1",
}


@lru_cache(maxsize=1)
def load_open3d() -> ModuleType:
    """Return the `open3d` module, its libusb-1.0 preloaded from the `libusb-package` wheel.

    Open3D links libusb-1.0.so.0, which a fresh Debian lacks; a copy already in the process
    satisfies the loader. Raises `Open3dUnavailable`.
    """
    if importlib.util.find_spec("libusb_package") is not None:
        libusb = importlib.import_module("libusb_package")
        ctypes.CDLL(str(libusb.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    try:
        return importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        raise Open3dUnavailable(_sentence(str(error))) from error


def _sentence(message: str) -> str:
    for library, package in DEBIAN_PACKAGES.items():
        if library in message:
            return (
                f"Open3D needs the system library {library}: "
                f"install it with: sudo apt-get install {package}"
            )
    return f"Open3D cannot be loaded: {message}; run: make env"
