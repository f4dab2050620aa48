import json
import logging
import os
import sys

from mission.processes.logs import JsonLines, configure_logging, to_journal


def test_a_line_for_the_journal_is_its_priority_and_one_json_object():
    record = logging.LogRecord("a.b", logging.ERROR, "f", 1, "lost %d\nof them", (3,), None)
    line = JsonLines("flight").format(record)
    assert line.startswith("<3>{")
    assert "\n" not in line
    entry = json.loads(line[3:])
    assert entry["message"] == "lost 3\nof them"
    assert (entry["process"], entry["logger"], entry["level"]) == ("flight", "a.b", "error")


def test_an_exception_is_kept_whole():
    try:
        int("x")
    except ValueError:
        record = logging.LogRecord("a", logging.WARNING, "f", 1, "m", (), sys.exc_info())
    entry = json.loads(JsonLines("x").format(record)[3:])
    assert entry["exception"].splitlines()[-1].startswith("ValueError: ")


def test_the_journal_is_known_by_its_stream(monkeypatch, tmp_path):
    with (tmp_path / "stderr").open("w") as file:
        monkeypatch.setattr(sys, "stderr", file)
        stat = os.fstat(file.fileno())
        assert to_journal({"JOURNAL_STREAM": f"{stat.st_dev}:{stat.st_ino}"})
        assert not to_journal({"JOURNAL_STREAM": f"{stat.st_dev}:{stat.st_ino + 1}"})
        assert not to_journal({})


def test_a_line_names_its_process_even_where_a_module_is_called_main(tmp_path):
    (tmp_path / "log").mkdir()
    before = logging.getLogger().handlers[:]
    try:
        configure_logging("flight", tmp_path)
        logging.getLogger("__main__").error("no vehicle")
    finally:
        for handler in set(logging.getLogger().handlers) - set(before):
            handler.close()
        logging.basicConfig(handlers=before or None, force=True)
    line = (tmp_path / "log" / "flight.log").read_text()
    assert line.endswith(" ERROR flight: no vehicle\n")
