import json

import pytest
from typer.testing import CliRunner

from config.scenarios import scenario_path
from mission.cli.config_command import app


@pytest.fixture
def run(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


def test_show_tells_each_value_and_where_it_comes_from(run, monkeypatch):
    monkeypatch.setenv("BLADESCOUT_VEHICLE", "heron")
    result = run("show", "--config", scenario_path("demo"), "--set", "guard.max_height_m=90")
    assert result.exit_code == 0
    rows = {
        line.split()[0]: line.split()[1:] for line in result.stdout.splitlines() if line.strip()
    }
    assert rows["vehicle"] == ["heron", "BLADESCOUT_VEHICLE"]
    assert rows["guard.max_height_m"] == ["90.0", "--set"]
    assert rows["guard.max_lead_m"] == ["1.0", "default"]
    assert rows["sites.0.turbine"][0] == "windpact-1.5"


def test_show_as_json_is_one_object(run):
    shown = json.loads(run("show", "--set", "vehicle=heron", "--json").stdout)
    assert shown["settings"]["vehicle"] == "heron"
    assert shown["places"]["vehicle"] == "--set"


def test_check_passes_a_good_file(run):
    result = run("check", scenario_path("full"))
    assert result.exit_code == 0
    assert "every value can be used" in result.stdout


def test_check_exits_2_and_names_file_key_value_and_range(run, tmp_path):
    file = tmp_path / "[bold]bad.toml"
    file.write_text("[guard]\nmax_lead_m = 9\n")
    result = run("check", file)
    assert result.exit_code == 2
    said = result.stderr.replace("\n", "")
    for words in (str(file), "guard.max_lead_m", "= 9", "above 0 and at most 3"):
        assert words in said


def test_check_looks_at_the_file_alone(run, monkeypatch):
    monkeypatch.setenv("BLADESCOUT_VEHICLE", "not a name")
    assert run("check", scenario_path("demo")).exit_code == 0
