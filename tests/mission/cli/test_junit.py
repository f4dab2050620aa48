import xml.etree.ElementTree as ET

import pytest
from typer.testing import CliRunner

from mission.cli import simulate_command
from mission.cli.exits import Exit
from mission.cli.junit import Flown, write_junit
from mission.cli.main import app

MISSION = {
    "duration_s": 181.2,
    "rotor": {"stop_angle_deg": 61.4},
    "errors": {"stop_angle_deg": -0.04},
    "photos": {"kept": 12},
    "truth": {"min_clearance_m": 9.4},
}


def flown(scenario, code, words="x", folder=None, mission=MISSION):
    return Flown(scenario, code, words, 10.0, folder, mission)


@pytest.fixture
def report(tmp_path):
    def write(*all_flown):
        path = tmp_path / "ci" / "out.xml"
        write_junit(path, all_flown)
        return ET.parse(path).getroot()

    return write


def test_a_completed_mission_is_a_case_that_passed_with_its_figures(report, tmp_path):
    suite = report(flown("mine/calm.toml", Exit.DONE, folder=tmp_path))
    (case,) = suite.findall("testcase")
    assert (case.get("classname"), case.get("name")) == ("bladescout.simulate", "calm")
    assert case.find("failure") is None
    assert case.find("error") is None
    figures = {one.get("name"): one.get("value") for one in case.iter("property")}
    assert figures["errors.stop_angle_deg"] == "-0.04"
    assert figures["truth.min_clearance_m"] == "9.4"
    assert "report.html" in case.findtext("system-out")


def test_what_did_not_complete_is_a_failure_and_what_did_not_come_up_an_error(report):
    suite = report(
        flown("a", Exit.DONE),
        flown("b", Exit.UNFINISHED, "ended_safely: <battery> & wind"),
        flown("c", Exit.DEVICE, "the field did not come up", mission={}),
    )
    counts = [suite.get(name) for name in ("tests", "failures", "errors", "time")]
    assert counts == ["3", "1", "1", "30.0"]
    assert suite.find("testcase[@name='b']/failure").get("message") == (
        "ended_safely: <battery> & wind"
    )
    assert suite.find("testcase[@name='c']/error").get("message") == "the field did not come up"


def test_several_scenarios_are_flown_and_the_worst_is_the_exit_code(monkeypatch, tmp_path):
    ends = {"demo": Exit.DONE, "crosswind": Exit.UNFINISHED}
    asked = []

    def fly(name, settings, console, keep, *, silent):
        asked.append((name, settings.simulation.seed, silent))
        return flown(name, ends[name])

    monkeypatch.setattr(simulate_command, "_fly", fly)
    out = tmp_path / "out.xml"
    words = ["simulate", "demo", "crosswind", "--seed", "7", "--junit", str(out)]
    result = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "missions")])
    assert result.exit_code == Exit.UNFINISHED
    assert asked == [("demo", 7, False), ("crosswind", 7, False)]
    assert ET.parse(out).getroot().get("tests") == "2"


def test_a_scenario_that_cannot_be_used_is_told_before_anything_flies(monkeypatch, tmp_path):
    monkeypatch.setattr(simulate_command, "_fly", None)
    words = ["simulate", "demo", str(tmp_path / "none.toml"), "--junit", str(tmp_path / "out.xml")]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == Exit.CONFIGURATION
    assert not (tmp_path / "out.xml").exists()
