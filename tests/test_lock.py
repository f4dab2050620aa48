"""The lock installs the same everywhere: exact, hashed, and from whatever index one has."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
LOCK = (ROOT / "requirements.lock").read_text()
ENTRIES = re.findall(
    r"^([a-z0-9-]+)==\S+(?: ; .*?)? \\\n((?:    --hash=.*\n)+)", LOCK, re.MULTILINE
)


def test_every_line_belongs_to_an_exact_and_hashed_package():
    lines = sum(1 + hashes.count("\n") for _, hashes in ENTRIES)
    assert lines == len(LOCK.splitlines())


def test_no_host_or_path_is_named():
    assert not re.search(r"https?:|file:|@|--index|--find-links|#", LOCK)


def test_everything_that_the_project_asks_for_is_locked():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wanted = [*project["project"]["dependencies"], *project["dependency-groups"]["dev"]]
    names = {re.match(r"[A-Za-z0-9_.-]+", line)[0].lower().replace("_", "-") for line in wanted}
    assert names <= {name for name, _ in ENTRIES}
