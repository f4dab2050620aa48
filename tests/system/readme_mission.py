"""The README's remote mission, as a newcomer types it: a clean clone, each line in a shell.

::

    python -m tests.system.readme_mission [--here]

Lines that stay (the field, the daemon, the console) get a terminal of their own, and the next line
is typed once they have said something. It ends by an exit code of 0 when the mission was completed
and its report is there. ``--here``: in this folder and its environment, not in a clone.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
HEADING = "## A remote mission, here"
ACTIVATE = ". .venv/bin/activate"
MOST = 10
"""Commands that it may take."""
_STAY = ("field", "serve", "console")
_SPEAK_S = 240.0
_READ_S = 2.0
_MISSION_S = 3600.0
_CONSOLE = re.compile(rb"http://127\.0\.0\.1:\d+/")


@dataclass(frozen=True, slots=True)
class Typed:
    """One line and what came of it."""

    line: str
    wall_s: float
    code: int | None
    """None: it stays."""


def lines_of(readme: str) -> list[str]:
    """Return the lines of the first block of commands below the heading."""
    _, _, below = readme.partition(HEADING)
    block = re.search(r"```sh\n(.*?)```", below, re.DOTALL)
    if block is None:
        raise LookupError(f"no commands below {HEADING!r}")
    return [line for line in block.group(1).splitlines() if line.strip()]


def stays(line: str) -> bool:
    """Return whether a line goes on until it is ended."""
    words = line.split()
    return len(words) > 1 and words[0] == "bladescout" and words[1] in _STAY


class Terminal:
    """Types lines in a folder; what stays is ended at the end, the last first."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder = folder
        self._stack = stack
        self._said = tempfile.mkdtemp(prefix="readme-mission-")
        stack.callback(shutil.rmtree, self._said, ignore_errors=True)
        self._active = False
        self.typed: list[Typed] = []

    def type(self, line: str) -> Path:
        """Type a line; return the file of what it says. Raises `SystemExit` where it fails."""
        _say(f"$ {line}")
        begun_s = time.monotonic()
        self._active = self._active or line == ACTIVATE
        said = Path(self._said) / f"{len(self.typed)}.txt"
        process = self._begin(line, said)
        if stays(line):
            self._stack.callback(_end, process)
            _wait_for_words(process, said, line)
            code = None
        else:
            code = process.wait(_MISSION_S)
        self.typed.append(Typed(line, time.monotonic() - begun_s, code))
        _say(said.read_text(errors="replace").rstrip()[-2000:])
        if code:
            sys.exit(f"{line!r} ended with {code}")
        return said

    def _begin(self, line: str, said: Path) -> subprocess.Popen[bytes]:
        before = f"{ACTIVATE} && " if self._active else ""
        with said.open("wb") as out:
            return subprocess.Popen(
                ("bash", "-c", before + line),
                cwd=self._folder,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env=os.environ | {"PYTHONUNBUFFERED": "1"},
            )


def _wait_for_words(process: subprocess.Popen[bytes], said: Path, line: str) -> None:
    """Wait until it has said something and been quiet for a moment, as a reader does."""
    until_s = time.monotonic() + _SPEAK_S
    read, since_s = 0, time.monotonic()
    while not read or time.monotonic() - since_s < _READ_S:
        if process.poll() is not None or time.monotonic() > until_s:
            sys.exit(f"{line!r}: {said.read_text(errors='replace') or 'said nothing'}")
        time.sleep(0.1)
        if said.stat().st_size != read:
            read, since_s = said.stat().st_size, time.monotonic()


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _end(process: subprocess.Popen[bytes]) -> None:
    """End what a person ends by Ctrl-C."""
    os.killpg(process.pid, signal.SIGINT)
    try:
        process.wait(30)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def fresh_clone() -> Iterator[Path]:
    """Yield a clone of what is committed."""
    with tempfile.TemporaryDirectory(prefix="bladescout-clone-") as folder:
        clone = Path(folder) / "bladescout"
        subprocess.run(("git", "clone", "--quiet", ROOT, clone), check=True)
        yield clone


def _fly(folder: Path) -> list[Typed]:
    lines = lines_of((folder / "README.md").read_text())
    with ExitStack() as stack:
        terminal = Terminal(folder, stack)
        # Who watches a mission has the page open meanwhile.
        for line in sorted(lines, key=lambda line: " watch " in line):
            said = terminal.type(line)
            page = _CONSOLE.search(said.read_bytes())
            if page is not None:
                with urllib.request.urlopen(page.group().decode(), timeout=10) as answer:
                    _say(f"the console answers: {len(answer.read())} bytes")
        _say("the daemon and the field are ended")
    return terminal.typed


def _check(folder: Path) -> None:
    (mission,) = sorted((folder / "missions").iterdir())[-1:]
    told = json.loads((mission / "mission.json").read_text())
    if told["state"] != "completed" or not (mission / "report.html").is_file():
        sys.exit(f"{mission}: {told['state']}")
    _say(f"{mission.name}: completed in {told['duration_s']:.0f} s, with a report")


def main() -> None:
    """Type it all and say how long each line took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--here", action="store_true", help="not in a clone")
    here = parser.parse_args().here
    with ExitStack() as stack:
        folder = ROOT if here else stack.enter_context(fresh_clone())
        typed = _fly(folder)
        _check(folder)
    for one in typed:
        _say(f"{one.wall_s:7.1f} s  {one.line}")
    _say(f"{len(typed)} commands, {sum(one.wall_s for one in typed):.0f} s of wall time")
    if len(typed) >= MOST:
        sys.exit(f"{MOST} commands or more")


if __name__ == "__main__":
    main()
