"""Mistakes in what a person types: one sentence with place and key, exit 2, no traceback."""

import json

import pytest
from typer.testing import CliRunner

from mission.cli.main import app

FILES = {
    "bad.toml": "vehicle = 'heron'\n[guard\n",
    "unknown.toml": "[guard]\nmax_hight_m = 90\n",
    "range.toml": "[guard]\nmax_lead_m = 9\n",
    "empty.toml": "",
}


START = ("start", "hill-3", "--operator", "ada", "--rotor-locked")


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    for mission in ("1-demo", "2-demo"):
        (tmp_path / "missions" / mission).mkdir(parents=True)
        (tmp_path / "missions" / mission / "mission.json").write_text("{}")
    (tmp_path / "notes").write_text("no TOML file by its name")
    (tmp_path / "kept" / "field").mkdir(parents=True)
    return lambda *words, **how: CliRunner().invoke(app, words, **how)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("simulate", "nowhere"), ("nowhere", "demo", "full", "--list")),
        (("simulate", "dmo"), ("did you mean 'demo'?",)),
        (("simulate", "lidar-stop"), ("did you mean 'faults/lidar-stops'?",)),
        (("simulate", "faults/rain"), ("faults/rain", "faults/fog", "faults/gust")),
        (("simulate", "notes"), ("'notes'", "ends in .toml")),
        (("simulate", "missing.toml"), ("missing.toml", "no such file")),
        (("simulate", "bad.toml"), ("bad.toml", "not valid TOML", "line 2")),
        (("simulate", "unknown.toml"), ("unknown.toml", "guard.max_hight_m")),
        (("simulate", "range.toml"), ("range.toml", "guard.max_lead_m", "9", "at most 3")),
        (("simulate", "empty.toml"), ("empty.toml", "sites")),
        (("simulate", "demo", "--set", "guard.max_lead_m=9"), ("--set", "at most 3")),
        (("simulate", "demo", "--set", "nonsense"), ("nonsense", "section.key=value")),
        (("simulate", "demo", "--set", "sites.0.turbine=mill"), ("mill", "windpact-1.5")),
        (("simulate", "demo", "--seed", "-1"), ("error: --seed: simulation.seed", "-1")),
        (("simulate", "demo", "--speed", "fast"), ("error: --speed: simulation.speed", "fast")),
        (("estimate", "c.npz", "--method", "guess"), ("error: --method: ", "guess", "fermat")),
        (("simulate", "demo", "--autopilot", "tcp:nowhere"), ("tcp:nowhere", "udpin://")),
        (("simulate", "demo", "--out", "bad.toml"), ("bad.toml", "no folder")),
        (("simulate", "demo", "--keep", "kept"), ("--keep kept", "earlier run")),
        (("serve", "--config", "bad.toml"), ("bad.toml", "not valid TOML")),
        (("serve", "--set", "guard.max_lead_m=9"), ("guard.max_lead_m", "at most 3")),
        (("config", "check", "unknown.toml"), ("unknown.toml", "guard.max_hight_m")),
        (("config", "explain", "guard.max_led_m"), ("did you mean guard.max_lead_m?",)),
        (("config", "explain", "gard"), ("gard is not a known setting", "guard")),
        (("config", "show", "--set", "vehicle=a/b"), ("vehicle", "a/b")),
        (("report", "."), ("mission.json",)),
        (("status", "--vehicle", "a/**"), ("--vehicle", "a/**")),
        (("status", "--router", "nowhere"), ("--router", "nowhere", "tcp/HOST:PORT")),
        ((*START, "--blades", "X"), ("--blades 'X'", "'A', 'B' or 'C'")),
        ((*START, "--blades", "A=1,D=2"), ("--blades 'D'",)),
        ((*START, "--sides", "PS,UP"), ("--sides 'UP'", "'TE'")),
        ((*START, "--nacelle-yaw", "400"), ("--nacelle-yaw 400.0: must be less than 360",)),
        ((*START, "--launch", "nan,2"), ("--launch nan",)),
        (("start", "hill 3", *START[2:]), ("TURBINE 'hill 3'", "1 to 64 letters")),
        (("start", "hill-3"), ("--operator is missing",)),
        (("start", "hill-3", "--operator", "ada"), ("--rotor-locked is missing",)),
        (("router", "--keys", "keys", "--remote", "foo"), ("--remote 'foo'", "tls/HOST:PORT")),
        (("console", "--router", "nowhere"), ("--router", "nowhere", "tls/HOST:PORT")),
        (("watch", "--all", "--router", "nowhere"), ("--router", "nowhere")),
        (("serve", "--set", "bus.listen=nowhere"), ("bus.listen", "nowhere")),
        (("farm", "missing.toml"), ("missing.toml", "No such file")),
        (("farm", "bad.toml"), ("bad.toml", "not valid TOML", "line 2")),
        (("farm", "empty.toml"), ("empty.toml", "operator")),
        (("keys", "keys", "--vehicle", "heron=not a host"), ("not a host",)),
        (("estimate", "cloud.npz", "--scale", "0.6"), ("--scale 0.6", "--turbine")),
        (("verify", "kept"), ("kept", "SHA256SUMS")),
        (("simulate", "demo", "--junit", "kept"), ("--junit kept", "folder")),
        (("simulate", "demo", "--junit", "notes/m.xml"), ("notes", "no folder")),
        (("bench", "missions", "--scenario", "dmo"), ("did you mean 'demo'?",)),
        (("bench", "missions", "--out", "notes"), ("notes", "no folder")),
        (("bench", "angle", "--read", "nope"), ("--read nope", "No such file")),
        (("bench", "angle", "--read", "notes"), ("--read notes", "--keep")),
        (("bench", "exposure", "--brackets", "kept"), ("kept", "photos")),
        (("install-service", "--config", "empty.toml", "--user", "a b"), ("--user 'a b'",)),
        (("verify", "nowhere"), ("nowhere", "no such folder")),
        (("report", "nowhere"), ("nowhere", "no such folder")),
        (("report", "missions"), ("missions holds 2 missions", "missions/2-demo")),
        (("replay", "missions"), ("missions holds 2 missions", "missions/2-demo")),
        (("replay", "notes"), ("notes", "no MCAP file")),
        (("estimate", "kept"), ("kept", "folder")),
        (("export", "kept", "--to", "out"), ("kept", "no photos")),
        (("replay", "kept"), ("kept", "recording.mcap")),
        (("locate", "bad.toml", "1", "2"), ("bad.toml", ".jpg")),
    ],
)
def test_what_cannot_be_meant_is_told_with_place_and_key(run, words, named):
    result = run(*words)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.startswith("error: ")
    assert len(result.stderr.splitlines()) == 1
    for word in named:
        assert word in result.stderr


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("simulate", "dmo"), 2),
        (("verify", "kept"), 2),
        (("estimate", "nowhere.npz"), 2),
        (("status", "--router", "tcp/127.0.0.1:1"), 5),
    ],
)
def test_who_asked_for_json_is_told_a_mistake_as_one_object_too(run, words, code):
    result = run(*words, "--json")
    told = json.loads(result.stdout)
    assert told["ok"] is False
    assert told["exit_code"] == result.exit_code == code
    assert result.stderr == f"error: {told['error']}\n"
    # The next command of the same process was not asked to.
    assert run("verify", "kept").stdout == ""


@pytest.mark.parametrize(("variable", "value"), [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_a_terminal_without_colours_is_sent_none(run, monkeypatch, variable, value):
    assert "\x1b" in run("simulate", "dmo", color=True).stderr
    monkeypatch.setenv(variable, value)
    assert "\x1b" not in run("simulate", "dmo", color=True).stderr


def test_the_packaged_scenarios_are_listed_with_what_they_are(run):
    result = run("simulate", "--list")
    assert result.exit_code == 0
    told = dict(line.split(maxsplit=1) for line in result.stdout.splitlines())
    assert "all twelve sides" in told["full"]
    assert "LiDAR falls silent" in told["faults/lidar-stops"]


@pytest.mark.parametrize("words", [("simulate", "--nothing"), ("fly",), ("start",)])
def test_words_that_are_no_command_exit_2_as_well(run, words):
    result = run(*words)
    assert result.exit_code == 2
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    ("answers", "code", "said"),
    [("ada\nn\n", 3, "nothing was started"), ("ada\ny\n", 5, "no daemon answers")],
)
def test_who_sits_at_a_terminal_is_asked_and_may_say_no(run, monkeypatch, answers, code, said):
    monkeypatch.setattr("mission.cli.typed._need_terminal", lambda _: None)
    result = run("start", "hill-3", "--router", "tcp/127.0.0.1:1", input=answers)
    assert result.exit_code == code
    assert said in result.stderr
    assert "Who starts the mission?" in result.stderr
    # The runner shows what is typed, as a terminal does; the questions are not there.
    assert result.stdout.split() == answers.split()
