import json
from types import SimpleNamespace

import pytest

from benchmarks import missions

MISSION = {
    "state": "completed", "words": "landed", "duration_s": 430.0, "coverage": 0.99,
    "phases": [{"phase": "estimate", "from_s": 100.0, "to_s": 107.5}],
    "rotor": {"sigma_deg": 0.3}, "photos": {"kept": 63}, "errors": {"stop_angle_deg": -0.25},
    "truth": {"stop_angle_deg": 119.9, "min_clearance_m": 9.2},
    "timing": {"real_time_factor": 2.3, "setpoint_gap_ms": {"p99": 63.0}},
}  # fmt: skip


@pytest.fixture
def flights(monkeypatch):
    """Stand in for the command; every third flight ends without a word of JSON."""
    begun = []

    def run(words, **_):
        begun.append(words)
        if len(begun) % 3 == 0:
            return SimpleNamespace(stdout="", stderr="error: the port is taken\n", returncode=5)
        return SimpleNamespace(stdout=json.dumps(MISSION), stderr="", returncode=0)

    monkeypatch.setattr(missions.subprocess, "run", run)
    return begun


def test_each_mission_is_one_line_with_its_figures(flights, tmp_path):
    flown = list(missions.fly([7, 8, 9], "demo", ["guard.max_height_m=150"], tmp_path, edges=True))
    assert [one.state for one in flown] == ["completed", "completed", "failed"]
    assert flown[0].estimate_s == 7.5
    assert flown[0].error_deg == -0.25
    assert flown[2].words == "error: the port is taken"
    assert "simulation.truth.stop_angle_deg=60.0" in flights[1]
    assert "guard.max_height_m=150" in flights[2]
    figures = missions.figures(flown)
    assert figures["completed"] == 2
    assert figures["error_max_deg"] == 0.25
    assert figures["clearance_min_m"] == 9.2


def test_a_run_that_was_broken_off_goes_on_where_it_stood(flights, tmp_path):
    list(missions.fly([7, 8], "demo", [], tmp_path, edges=False))
    assert len(list(missions.fly([7, 8, 9], "demo", [], tmp_path, edges=False))) == 3
    assert len(flights) == 3


def test_seeds_are_drawn_anew_unless_a_first_one_is_named():
    assert missions.seeds_of(3, 40) == [40, 41, 42]
    assert missions.seeds_of(20, None) != missions.seeds_of(20, None)
