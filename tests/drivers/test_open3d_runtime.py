import importlib

import pytest

from drivers import open3d_runtime
from drivers.open3d_runtime import DEBIAN_PACKAGES, Open3dUnavailable, load_open3d


@pytest.mark.parametrize("library", DEBIAN_PACKAGES)
def test_a_missing_library_is_named_with_the_package_that_brings_it(library, monkeypatch):
    def import_module(name):
        if name == "open3d":
            raise ImportError(f"{library}: cannot open shared object file")
        return importlib.__import__(name)

    monkeypatch.setattr(open3d_runtime.importlib, "import_module", import_module)
    with pytest.raises(Open3dUnavailable, match=f"apt-get install {DEBIAN_PACKAGES[library]}$"):
        load_open3d.__wrapped__()
