"""What import-linter holds, read once more from the syntax: it must not rot with a setting."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]
SHARED = {"perception.values", "perception.geometry"}


def imports_of(file):
    """Yield the modules that a file imports, wherever in it the import stands."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def imported(package, top):
    return {
        (str(file.relative_to(ROOT)), name)
        for file in (ROOT / package).rglob("*.py")
        for name in imports_of(file)
        if name == top or name.startswith(f"{top}.")
    }


def is_shared(name):
    return any(name == module or name.startswith(f"{module}.") for module in SHARED)


def test_of_perception_the_drivers_know_only_its_values_and_geometry():
    assert {
        found for found in imported("drivers", "perception") if not is_shared(found[1])
    } == set()


def test_the_configuration_knows_nothing_above_it():
    for package in ("perception", "drivers", "mission", "bladescout"):
        assert imported("config", package) == set()


def test_perception_touches_no_device_and_no_clock():
    for package in ("drivers", "mission", "bladescout", "asyncio", "time", "socket", "zenoh"):
        assert imported("perception", package) == set()
