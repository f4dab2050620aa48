"""Scenarios shipped with the product: ordinary settings files beside this one.

Those of `faults/` rehearse the cases of SAFETY.md.
"""

from __future__ import annotations

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
        raise ConfigError(f"scenario {name!r} is not known (known: {', '.join(scenario_names())})")
    return _FOLDER / f"{name}.toml"
