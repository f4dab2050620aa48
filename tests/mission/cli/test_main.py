"""The last line of defence: a defect is told in two lines, its traceback kept in a file."""

import errno
import json
import os
import tempfile

import pytest

from mission.cli import main
from mission.cli.exits import want_json


def broken():
    raise RuntimeError("the sky is green")


@pytest.fixture(autouse=True)
def _a_defect(monkeypatch, tmp_path):
    (tmp_path / "here").mkdir()
    (tmp_path / "temporary").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setattr(main, "app", broken)


def test_a_defect_is_told_without_a_traceback_which_is_kept_here(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main.run()
    assert ended.value.code == 6
    said = capsys.readouterr().err
    assert "RuntimeError: the sky is green" in said
    assert "Traceback" not in said
    assert "Traceback" in (tmp_path / "here" / "bladescout-error.log").read_text()


def test_who_asked_for_json_is_told_of_a_defect_by_it_too(monkeypatch, capsys):
    def asked():
        want_json(True)
        broken()

    monkeypatch.setattr(main, "app", asked)
    try:
        with pytest.raises(SystemExit):
            main.run()
    finally:
        want_json(False)
    told = json.loads(capsys.readouterr().out)
    assert told == {"ok": False, "exit_code": 6, "error": "RuntimeError: the sky is green"}


def test_where_nothing_can_be_written_here_it_is_kept_with_the_temporary_files(tmp_path, capsys):
    (tmp_path / "here" / "bladescout-error.log").mkdir()
    with pytest.raises(SystemExit):
        main.run()
    kept = tmp_path / "temporary" / "bladescout-error.log"
    assert str(kept) in capsys.readouterr().err
    assert "the sky is green" in kept.read_text()


def test_a_full_disk_is_no_defect_of_ours(monkeypatch, tmp_path, capsys):
    def full():
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "missions/x")

    monkeypatch.setattr(main, "app", full)
    with pytest.raises(SystemExit) as ended:
        main.run()
    assert ended.value.code == 6
    assert capsys.readouterr().err == "error: missions/x: No space left on device\n"
    assert list((tmp_path / "here").iterdir()) == []
