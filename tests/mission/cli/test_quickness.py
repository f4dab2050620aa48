"""Help and short requests load none of the heavy libraries."""

import subprocess
import sys

import pytest

HEAVY = {"av", "cv2", "jinja2", "mavsdk", "numba", "open3d", "pymavlink", "scipy", "sklearn"}


@pytest.mark.parametrize(
    ("what", "beside"),
    [
        ("import mission.cli.main", {"numpy", "pydantic", "zenoh"}),
        ("import mission.cli.progress, mission.remote.client", set()),
        ("import mission.cli.config_command, config.sources", set()),
    ],
)
def test_it_loads_only_what_it_needs(what, beside):
    listing = f"{what}\nimport sys\nprint(*sorted(sys.modules))"
    run = subprocess.run([sys.executable, "-c", listing], capture_output=True, check=True)
    loaded = set(run.stdout.decode().split())
    assert "mission.cli" in loaded
    assert loaded & (HEAVY | beside) == set()
