import stat

import pytest
from typer.testing import CliRunner

from mission.cli.main import app
from mission.records.report_pdf import NoPdf, write_pdf


def a_browser(tmp_path, monkeypatch, script):
    """Stand in for Chromium: a program that takes its arguments."""
    folder = tmp_path / "bin"
    folder.mkdir()
    program = folder / "chromium"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")


def test_the_page_is_printed_beside_itself(mission_dir, tmp_path, monkeypatch):
    script = 'for a in "$@"; do case $a in --print-to-pdf=*) echo PDF > "${a#*=}";; esac; done'
    a_browser(tmp_path, monkeypatch, script)
    run = CliRunner().invoke(app, ["report", str(mission_dir), "--pdf"])
    assert run.exit_code == 0
    assert (mission_dir / "report.pdf").read_text() == "PDF\n"
    assert "report.pdf" in run.output


def test_a_browser_that_fails_is_quoted_and_leaves_no_half_file(mission_dir, tmp_path, monkeypatch):
    a_browser(tmp_path, monkeypatch, "echo cannot start here >&2; exit 3")
    with pytest.raises(NoPdf, match="cannot start here"):
        write_pdf(mission_dir / "report.html")
    assert list(mission_dir.glob("*.pdf*")) == []


def test_without_a_browser_it_is_said_what_to_install(mission_dir, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    run = CliRunner().invoke(app, ["report", str(mission_dir), "--pdf"])
    assert run.exit_code == 6
    assert "apt install chromium" in run.output
    assert (mission_dir / "report.html").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--set", "guard.max_height_m=3"], "only report.*"),
        (["--set", "report.nonsense=3"], "report.nonsense"),
        (["--set", "report.time_zone=Nowhere"], "time zone"),
        (["--findings", "nothing.csv"], "cannot be read"),
        (["--against", "nothing"], "there is no such folder"),
    ],
)
def test_what_cannot_be_reported_is_refused_in_one_sentence(mission_dir, options, words):
    run = CliRunner().invoke(app, ["report", str(mission_dir), *options])
    assert run.exit_code == 2
    assert words in run.output
