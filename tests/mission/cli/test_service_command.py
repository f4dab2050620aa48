import configparser
import shutil
import subprocess

import pytest
from typer.testing import CliRunner

from mission.cli import service_command
from mission.cli.exits import Exit
from mission.cli.main import app

SETTINGS = 'vehicle = "heron"\n[bus]\nremote = "tls/0.0.0.0:7448"\nkeys = "/etc/bladescout/keys"\n'


def install(folder, *words):
    config = folder / "drone.toml"
    config.write_text(SETTINGS)
    return CliRunner().invoke(app, ["install-service", "--config", str(config), *map(str, words)])


@pytest.fixture
def unit(tmp_path):
    done = install(tmp_path, "--root", tmp_path / "root")
    assert done.exit_code == Exit.DONE, done.output
    return tmp_path / "root/etc/systemd/system/bladescout.service"


def parsed(unit):
    parser = configparser.RawConfigParser(strict=False)
    parser.optionxform = str
    parser.read_string(unit.read_text())
    return parser["Service"]


def test_the_unit_is_complete_and_watched(unit):
    service = parsed(unit)
    assert "@" not in unit.read_text().replace("@system-service", "")
    assert service["Type"] == "notify"
    assert service["WatchdogSec"] == "10"
    assert service["ExecStart"].endswith(
        "bladescout serve --config /etc/bladescout/bladescout.toml"
    )
    assert (service["StateDirectory"], service["LogsDirectory"]) == ("bladescout", "bladescout")
    assert service["NoNewPrivileges"] == "yes"


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_systemd_finds_nothing_wrong_with_the_unit_and_little_exposed(unit):
    verified = subprocess.run(
        ["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False
    )
    assert (verified.returncode, verified.stderr) == (0, "")
    rated = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--threshold=25", unit],
        capture_output=True,
        check=False,
    )
    assert rated.returncode == 0


def test_settings_and_receive_buffers_come_with_it(unit, tmp_path):
    assert (tmp_path / "root/etc/bladescout/bladescout.toml").read_text() == SETTINGS
    assert "rmem_max" in (tmp_path / "root/etc/sysctl.d/90-bladescout.conf").read_text()


def test_a_dry_run_shows_all_and_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(service_command, "_carry_out", lambda plan: pytest.fail("carried out"))
    shown = install(tmp_path, "--dry-run").output
    for word in ("useradd", "WatchdogSec", "systemctl enable --now", "chgrp -R bladescout /etc"):
        assert word in shown


def test_without_root_it_is_only_shown(tmp_path, monkeypatch):
    monkeypatch.setattr(service_command.os, "geteuid", lambda: 1000)
    monkeypatch.setattr(service_command, "_carry_out", lambda plan: pytest.fail("carried out"))
    done = install(tmp_path)
    assert done.exit_code == Exit.DONE
    assert "run it again as root" in done.output


def test_settings_that_cannot_be_used_are_not_installed(tmp_path):
    config = tmp_path / "bad.toml"
    config.write_text("[bus]\nremote = 3\n")
    words = ["install-service", "--config", str(config), "--root", str(tmp_path / "root")]
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code == Exit.CONFIGURATION
    assert "bus.remote" in refused.output
    assert not (tmp_path / "root").exists()
