"""Scenarios shipped with the product: ordinary settings files beside this one.

Those of `faults/` rehearse the cases of SAFETY.md.
"""

from __future__ import annotations

import difflib
from pathlib import Path

from config.errors import ConfigError

_FOLDER = Path(__file__).parent


def scenario_names() -> tuple[str, ...]:
    """Return the names that `scenario_path` knows, sorted; what rehearses a fault comes last."""
    return (*_stems("*.toml"), *(f"faults/{stem}" for stem in _stems("faults/*.toml")))


def _stems(pattern: str) -> list[str]:
    return sorted(file.stem for file in _FOLDER.glob(pattern))


def scenario_path(name: str) -> Path:
    """Return the file of a packaged scenario. Raises `ConfigError` for a name not known."""
    if name not in scenario_names():
        raise ConfigError(f"scenario {name!r} is not known{_hint(name)}")
    return _FOLDER / f"{name}.toml"


def _hint(name: str) -> str:
    """Return what may have been meant, and what there is."""
    if name and Path(name).is_file():
        return ": a file of one's own ends in .toml"
    names = scenario_names()
    # Who leaves the folder out, or types a part of the name, is understood as well.
    by_stem = {known.rpartition("/")[2]: known for known in reversed(names)}
    close = difflib.get_close_matches(name.rpartition("/")[2].lower(), by_stem, n=1)
    meant = f"; did you mean {by_stem[close[0]]!r}?" if close else ""
    faults = [known for known in names if "/" in known]
    if name.startswith("faults"):
        return f"{meant} (known: {', '.join(faults)})"
    plain = [known for known in names if "/" not in known]
    return (
        f"{meant} (known: {', '.join(plain)} and {len(faults)} of faults/, listed by "
        "bladescout simulate --list; or name a TOML file)"
    )


def scenario_summary(name: str) -> str:
    """Return the first sentence of a packaged scenario's opening comment."""
    lines: list[str] = []
    for line in scenario_path(name).read_text("utf-8").splitlines():
        if not line.startswith("# "):
            break
        lines.append(line.removeprefix("# "))
    words = " ".join(lines).partition(": ")[2]
    return words.partition(". ")[0].rstrip(".")
