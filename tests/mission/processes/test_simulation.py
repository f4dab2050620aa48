"""The simulated field as its owner sees it: ended at once where it was never up."""

import json
import subprocess
import sys
import time

import pytest

from config.settings import Settings
from mission.processes import simulation
from mission.processes.simulation import Field

#: Deaf to the end of its input, as a world is that is being drawn.
DRAWING = "import time; time.sleep(60)"
UP = """
import json, sys, time
print(json.dumps({"ready": True}), flush=True)
sys.stdin.read()
time.sleep(0.3)
print("ended by itself", file=sys.stderr)
"""


@pytest.fixture
def field(monkeypatch, tmp_path):
    begun = subprocess.Popen

    def make(program):
        def popen(_, **how):
            return begun([sys.executable, "-c", program], **how)

        monkeypatch.setattr(simulation.subprocess, "Popen", popen)
        (tmp_path / "told.json").write_text(
            json.dumps({"site": {"name": "demo", "turbine": "v90-2.0"}})
        )
        return Field(Settings(), tmp_path)

    return make


def test_a_field_that_is_still_being_drawn_is_ended_at_once(field):
    one = field(DRAWING)
    begun_s = time.monotonic()
    one.close()
    assert not one.runs()
    assert time.monotonic() - begun_s < 5


def test_a_field_that_is_up_is_let_end_by_itself(field, tmp_path):
    one = field(UP)
    assert one.wait_ready().name == "demo"
    one.close()
    assert not one.runs()
    assert "ended by itself" in (tmp_path / "field.log").read_text()
