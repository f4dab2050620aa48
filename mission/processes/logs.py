"""How the processes log: readable lines on a terminal and in files, JSON in systemd's journal."""

from __future__ import annotations

import json
import logging
import os
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

Form = Literal["auto", "text", "json"]
#: syslog levels, as systemd reads them at the beginning of a line.
_PRIORITY = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))


class JsonLines(logging.Formatter):
    """One JSON object a line, after the priority that the journal takes off."""

    def __init__(self, process: str) -> None:
        super().__init__()
        self._process = process

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a record."""
        priority = next((p for level, p in _PRIORITY if record.levelno >= level), 7)
        entry: dict[str, object] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "process": self._process,
            "logger": record.name,
            "message": record.getMessage(),
        }
        if record.exc_info:
            entry["exception"] = self.formatException(record.exc_info)
        return f"<{priority}>{json.dumps(entry, ensure_ascii=False)}"


def to_journal(environment: Mapping[str, str] | None = None) -> bool:
    """Return whether standard error leads to systemd's journal."""
    told = os.environ if environment is None else environment
    device, _, inode = told.get("JOURNAL_STREAM", "").partition(":")
    if not inode:
        return False
    try:
        stat = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError):
        return False
    return (device, inode) == (str(stat.st_dev), str(stat.st_ino))


def configure_logging(name: str, run_dir: Path | None = None, form: Form = "auto") -> None:
    """Log to standard error, or to a file of the run directory where one is wanted."""
    handler: logging.Handler
    log_dir = None if run_dir is None else run_dir / "log"
    if log_dir is not None and log_dir.is_dir():
        handler = logging.FileHandler(log_dir / f"{name}.log")
        form = "text" if form == "auto" else form
    else:
        handler = logging.StreamHandler(sys.stderr)
    as_json = form == "json" or (form == "auto" and to_journal())
    # The module that a process was started by is called __main__: the process says more.
    text = logging.Formatter(f"%(asctime)s %(levelname)s {name}: %(message)s")
    handler.setFormatter(JsonLines(name) if as_json else text)
    logging.basicConfig(level=logging.INFO, handlers=[handler], force=True)
