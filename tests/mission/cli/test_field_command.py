"""The simulated devices alone: what a daemon of one's own is told of them."""

from contextlib import contextmanager

import pytest
from typer.testing import CliRunner

from config.simulation import Simulation
from config.sources import load
from config.turbine import Site
from mission.cli.exits import Exit
from mission.cli.main import app
from mission.processes import simulation


class FieldOfPaper:
    """Is up at once, and ends at the second look."""

    def __init__(self, settings, run_dir):
        self.settings, self.looks = settings, 0
        (run_dir / "clock").write_bytes(b"\0" * 64)

    def wait_ready(self):
        return Site(name="demo", turbine="windpact-1.5", tower_north_m=70)

    def runs(self):
        self.looks += 1
        return self.looks < 2

    def close(self):
        pass


@contextmanager
def made(monkeypatch):
    fields = []

    def make(settings, run_dir):
        fields.append(FieldOfPaper(settings, run_dir))
        return fields[-1]

    monkeypatch.setattr(simulation, "Field", make)
    yield fields


def test_the_daemon_is_told_where_the_devices_are_and_nothing_of_the_scenario(
    tmp_path, monkeypatch
):
    with made(monkeypatch) as fields:
        words = ["field", "demo", "--seed", "7", "--speed", "1", "--out", str(tmp_path / "f")]
        ended = CliRunner().invoke(app, words)
    (field,) = fields
    assert ended.exit_code == Exit.DEVICE, "the field ended by itself, and that is said"
    assert "bladescout serve --config" in ended.output
    assert field.settings.simulation.seed == 7
    told = load([tmp_path / "f" / "drone.toml"], environment={}).settings
    assert told.autopilot.url == field.settings.autopilot.url
    assert told.camera.stream_url == field.settings.camera.stream_url
    assert [site.name for site in told.sites] == ["demo"]
    assert told.simulation == Simulation()
    assert told.bus.listen == "tcp/127.0.0.1:7447"
    assert (tmp_path / "f" / "clock").read_bytes() == b"\0" * 64


def test_a_scenario_that_is_not_there_is_told(tmp_path):
    refused = CliRunner().invoke(app, ["field", "nowhere", "--out", str(tmp_path / "f")])
    assert refused.exit_code == Exit.CONFIGURATION
    assert not (tmp_path / "f").exists()


@pytest.mark.parametrize("clock", ["nowhere", "."])
def test_a_clock_that_is_not_there_is_told(clock):
    refused = CliRunner().invoke(app, ["serve", "--clock", clock])
    assert refused.exit_code == Exit.CONFIGURATION
    assert "--clock" in refused.output
