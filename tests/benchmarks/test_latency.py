"""The bench of latency times steps that did their work, and says on what machine."""

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks import latency
from benchmarks.latency_scene import second_before_hub
from mission.cli.main import app
from perception.rotor import Refusal

SEED = 4


@pytest.fixture(scope="module")
def second():
    return second_before_hub(SEED)


@pytest.fixture(autouse=True)
def fewer_points(monkeypatch):
    monkeypatch.setattr(latency, "MANY", 20_000)


def test_the_second_is_one_of_a_real_sensor(second):
    assert 5_000 < len(second.turbine_w) < 12_000
    assert len(second.turbine_w) <= len(second.points_w)
    away = np.linalg.norm(second.turbine_w - second.hub_w, axis=1)
    assert np.median(away) < 25.0


def test_no_step_is_quick_because_it_had_nothing_to_do(second):
    for step in latency.steps(second, SEED):
        outcome = step.run()
        if step.name.strip() == "grid map":
            continue
        assert outcome is not None, step.name
        assert not isinstance(outcome, Refusal), (step.name, outcome)
        assert not (isinstance(outcome, float) and math.isnan(outcome)), step.name


def test_the_command_prints_figures_goals_and_machine():
    result = CliRunner().invoke(
        app, ["bench", "latency", "--repeats", "3", "--seed", str(SEED), "--json"]
    )
    assert result.exit_code == 0
    answer = json.loads(result.stdout)
    rows = {row["name"]: row for row in answer["rows"]}
    assert len(rows) == len(answer["rows"]) >= 11
    goals = [row["goal_ms"] for row in rows.values() if row["goal_ms"] is not None]
    assert sorted(goals) == pytest.approx([1.0, 5.0, 100 / 15, 20.0, 20.0, 50.0])
    for row in rows.values():
        assert 0 < row["cpu_p50_ms"] <= row["cpu_p99_ms"]
        assert 0 < row["wall_p50_ms"] <= row["wall_p99_ms"]
        assert (row["met"] is None) == (row["goal_ms"] is None)
    scan = rows["simulated scan of 0.1 s"]
    assert scan["times_real"] == pytest.approx(100.0 / scan["cpu_p50_ms"])
    assert scan["met"] == (scan["times_real"] >= 15.0)
    assert answer["machine"]["cores"] >= answer["machine"]["usable_cores"] >= 1


def test_a_person_is_shown_load_and_goals():
    result = CliRunner().invoke(app, ["bench", "latency", "--repeats", "3", "--seed", str(SEED)])
    assert result.exit_code == 0
    for word in ("CPU p50", "wall p50", "goal", "load", "cores", ">= 15x", "rotor fit"):
        assert word in result.stdout
