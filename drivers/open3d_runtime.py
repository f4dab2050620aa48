"""Open3D, loadable where the system has no libusb: the wheel brings it."""

from __future__ import annotations

import ctypes
import importlib
import importlib.util
from functools import lru_cache
from types import ModuleType


@lru_cache(maxsize=1)
def load_open3d() -> ModuleType:
    """Return the `open3d` module, its libusb-1.0 preloaded from the `libusb-package` wheel.

    Open3D links libusb-1.0.so.0, which a fresh Debian lacks; a copy already in the process
    satisfies the loader.
    """
    if importlib.util.find_spec("libusb_package") is not None:
        libusb = importlib.import_module("libusb_package")
        ctypes.CDLL(str(libusb.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    return importlib.import_module("open3d")
