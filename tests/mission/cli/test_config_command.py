import json

import pytest
from typer.testing import CliRunner

from config.scenarios import scenario_path
from config.settings import Settings
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


def test_a_setting_is_explained_with_what_it_may_be_and_its_default():
    shown = CliRunner().invoke(app, ["explain", "guard.max_lead_m"]).stdout
    assert "at most this far ahead" in shown
    assert "above 0 and at most 3; default 1.0" in shown


@pytest.mark.parametrize("section", ["guard", "tracking", "exposure", "lidar", "autopilot", "bus"])
def test_a_section_lists_each_of_its_keys(section):
    told = CliRunner().invoke(app, ["explain", section, "--json"]).stdout
    keys = [one["key"] for one in json.loads(told)["settings"]]
    default = Settings().model_dump()[section]
    assert keys == [f"{section}.{name}" for name in default]


@pytest.mark.parametrize("section", ["guard", "tracking", "estimation", "inspection"])
def test_what_decides_how_it_is_flown_says_what_it_is_for(section):
    told = CliRunner().invoke(app, ["explain", section, "--json"]).stdout
    assert [one["key"] for one in json.loads(told)["settings"] if not one["description"]] == []


def test_an_item_of_a_list_is_explained_too():
    shown = CliRunner().invoke(app, ["explain", "sites.0.tower_east_m"]).stdout
    assert "finite number" in shown
