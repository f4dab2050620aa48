"""Mistakes in what a person types: one sentence with place and key, exit 2, no traceback."""

import pytest
from typer.testing import CliRunner

from mission.cli.main import app

FILES = {
    "bad.toml": "vehicle = 'heron'\n[guard\n",
    "unknown.toml": "[guard]\nmax_hight_m = 90\n",
    "range.toml": "[guard]\nmax_lead_m = 9\n",
    "empty.toml": "",
}


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "kept" / "field").mkdir(parents=True)
    return lambda *words: CliRunner().invoke(app, words)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("simulate", "nowhere"), ("nowhere", "demo", "full")),
        (("simulate", "missing.toml"), ("missing.toml", "no such file")),
        (("simulate", "bad.toml"), ("bad.toml", "not valid TOML", "line 2")),
        (("simulate", "unknown.toml"), ("unknown.toml", "guard.max_hight_m")),
        (("simulate", "range.toml"), ("range.toml", "guard.max_lead_m", "9", "at most 3")),
        (("simulate", "empty.toml"), ("empty.toml", "sites")),
        (("simulate", "demo", "--set", "guard.max_lead_m=9"), ("--set", "at most 3")),
        (("simulate", "demo", "--set", "nonsense"), ("nonsense", "section.key=value")),
        (("simulate", "demo", "--set", "sites.0.turbine=mill"), ("mill", "windpact-1.5")),
        (("simulate", "demo", "--seed", "-1"), ("simulation.seed", "-1")),
        (("simulate", "demo", "--speed", "fast"), ("simulation.speed", "fast")),
        (("simulate", "demo", "--autopilot", "tcp:nowhere"), ("tcp:nowhere", "udpin://")),
        (("simulate", "demo", "--out", "bad.toml"), ("bad.toml", "no folder")),
        (("simulate", "demo", "--keep", "kept"), ("--keep kept", "earlier run")),
        (("serve", "--config", "bad.toml"), ("bad.toml", "not valid TOML")),
        (("serve", "--set", "guard.max_lead_m=9"), ("guard.max_lead_m", "at most 3")),
        (("config", "check", "unknown.toml"), ("unknown.toml", "guard.max_hight_m")),
        (("config", "show", "--set", "vehicle=a/b"), ("vehicle", "a/b")),
        (("report", "."), ("mission.json",)),
        (("status", "--vehicle", "a/**"), ("--vehicle", "a/**")),
        (("status", "--router", "nowhere"), ("--router", "nowhere", "tcp/HOST:PORT")),
        (("console", "--router", "nowhere"), ("--router", "nowhere", "tls/HOST:PORT")),
        (("watch", "--all", "--router", "nowhere"), ("--router", "nowhere")),
        (("serve", "--set", "bus.listen=nowhere"), ("bus.listen", "nowhere")),
        (("farm", "missing.toml"), ("missing.toml", "No such file")),
        (("farm", "bad.toml"), ("bad.toml", "not valid TOML", "line 2")),
        (("farm", "empty.toml"), ("empty.toml", "operator")),
        (("keys", "keys", "--vehicle", "heron=not a host"), ("not a host",)),
        (("estimate", "cloud.npz", "--scale", "0.6"), ("--scale 0.6", "--turbine")),
        (("verify", "kept"), ("kept", "SHA256SUMS")),
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


@pytest.mark.parametrize("words", [("simulate", "--nothing"), ("fly",), ("start",)])
def test_words_that_are_no_command_exit_2_as_well(run, words):
    result = run(*words)
    assert result.exit_code == 2
    assert "Traceback" not in result.stderr
