"""Where settings come from: defaults < files < environment < command line.

A settings file and a scenario are the same TOML. A variable names its key with double
underscores (``BLADESCOUT_GUARD__MAX_HEIGHT_M=150``); on the command line it is
``--set guard.max_height_m=150``, or an option that stands for one key. Every value remembers
where it came from, and every mistake becomes a `ConfigError` that names place, key, value and
what is allowed.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias, cast

import tomli_w
from pydantic import ValidationError

from config import explain
from config.errors import ConfigError
from config.presets import load_turbine
from config.scenarios import scenario_path
from config.settings import Settings

__all__ = ["ConfigError", "Loaded", "load", "load_settings", "scenario_path", "to_toml"]

PREFIX = "BLADESCOUT_"
DEFAULT = "default"
COMMAND_LINE = "--set"
_INDEX = re.compile(r"[0-9]{1,3}")

Table: TypeAlias = dict[str, object]


@dataclass(frozen=True, slots=True)
class Loaded:
    """The settings, and for each key the place that had the last word."""

    settings: Settings
    places: Mapping[str, str]
    """Of every setting, by its dotted key: `default`, a file, a variable, `--set`, an option."""

    def leaves(self) -> Iterator[tuple[str, object, str]]:
        """Yield (key, value, place) of every setting, in the order of the model."""
        for path, value in _leaves(self.settings.model_dump(mode="json")):
            key = explain.dotted(path)
            yield key, value, self.places[key]


def load_settings(
    files: Sequence[Path | str] = (),
    overrides: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
    options: Mapping[str, str] | None = None,
) -> Settings:
    """Return the settings; see `load`."""
    return load(files, overrides, environment, options).settings


def load(
    files: Sequence[Path | str] = (),
    overrides: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
    options: Mapping[str, str] | None = None,
) -> Loaded:
    """Return the settings and where each comes from.

    Later files win over earlier ones. ``overrides`` are texts ``section.key=value``; ``options``
    are such texts by the option that was typed for them (``--seed``), and have the last word.
    ``environment`` is the process's own unless given. Raises `ConfigError`.
    """
    merged = _Merged()
    for file in files:
        merged.lay(_read(Path(file)), str(file))
    variables = os.environ if environment is None else environment
    for name in sorted(variables):
        if name.startswith(PREFIX):
            merged.put(tuple(name[len(PREFIX) :].lower().split("__")), variables[name], name)
    typed = [(COMMAND_LINE, text) for text in overrides]
    for place, text in [*typed, *(options or {}).items()]:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise ConfigError(f"{place} {text!r}: write it as section.key=value")
        merged.put(tuple(key.strip().split(".")), value.strip(), place)
    settings = _validated(merged)
    _check_sites(settings, merged)
    paths = (path for path, _ in _leaves(settings.model_dump(mode="json")))
    return Loaded(
        settings,
        {
            explain.dotted(path): merged.place_of(path) if merged.has(path) else DEFAULT
            for path in paths
        },
    )


def to_toml(settings: Settings) -> str:
    """Return the settings as the text of a file that `load` reads back to the same value."""
    return tomli_w.dumps(settings.model_dump(mode="json", exclude_none=True))


class _Merged:
    """The tables laid over each other so far, and who wrote each key last."""

    def __init__(self) -> None:
        self.table: Table = {}
        self.places: dict[explain.Path, str] = {}

    def lay(self, table: Table, place: str) -> None:
        """Lay a file's table over what is there; lists are replaced whole."""
        self._lay(self.table, table, (), place)

    def put(self, keys: tuple[str, ...], text: str, place: str) -> None:
        """Set one key from a text; a whole number selects an item of a list."""
        path: explain.Path = tuple(int(key) if _INDEX.fullmatch(key) else key for key in keys)
        node: object = self.table
        for done, part in enumerate(path[:-1], start=1):
            node = _entered(node, part, path[:done], place)
        value = _parsed(text, explain.schema_of(path))
        _store(node, path[-1], value, path, place)
        self._claim(path, place)

    def _lay(self, below: Table, above: Table, path: explain.Path, place: str) -> None:
        for key, value in above.items():
            here = (*path, key)
            lower = below.get(key)
            if isinstance(value, dict) and (lower is None or isinstance(lower, dict)):
                inner = cast("Table", below.setdefault(key, {}))
                self._lay(inner, cast("Table", value), here, place)
                if not value:
                    self.places.setdefault(here, place)
            else:
                below[key] = value
                self._claim(here, place)

    def _claim(self, path: explain.Path, place: str) -> None:
        for old in [old for old in self.places if old[: len(path)] == path]:
            del self.places[old]
        self.places[path] = place

    def has(self, path: explain.Path) -> bool:
        """Return whether anyone wrote this key."""
        node: object = self.table
        for part in path:
            in_table = isinstance(node, dict) and part in node
            in_list = isinstance(node, list) and isinstance(part, int) and part < len(node)
            if not (in_table or in_list):
                return False
            node = cast("dict[str | int, object]", node)[part]
        return True

    def place_of(self, path: explain.Path) -> str:
        """Return who wrote a key, or the closest table round it (a missing key has no writer)."""
        for length in range(len(path), 0, -1):
            round_it = path[:length]
            if round_it in self.places:
                return self.places[round_it]
            for key, place in self.places.items():
                if key[:length] == round_it:
                    return place
        return "settings"


def _read(file: Path) -> Table:
    try:
        return tomllib.loads(file.read_bytes().decode("utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{file}: there is no such file") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{file}: not UTF-8 text (byte {error.start + 1})") from error
    except RecursionError:
        raise ConfigError(f"{file}: not valid TOML: nested too deep") from None
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # TOMLDecodeError, which names line and column; a path with NUL
        raise ConfigError(f"{file}: not valid TOML: {error}") from error


def _entered(node: object, part: str | int, path: explain.Path, place: str) -> object:
    """Return the table or list item under ``part``, made where it is missing."""
    if isinstance(node, dict) and isinstance(part, str):
        inner = node.setdefault(part, [] if _is_list(path) else {})
    elif isinstance(node, list) and isinstance(part, int) and part <= len(node):
        if part == len(node):
            node.append({})
        inner = node[part]
    else:
        raise ConfigError(f"{place}: {explain.dotted(path)} cannot be set: no such item or table")
    if not isinstance(inner, dict | list):
        raise ConfigError(f"{place}: {explain.dotted(path)} is one value: nothing can be set in it")
    return inner


def _is_list(path: explain.Path) -> bool:
    schema = explain.schema_of(path)
    return schema is not None and explain.takes_a_list(schema)


def _store(node: object, part: str | int, value: object, path: explain.Path, place: str) -> None:
    if isinstance(node, dict):
        node[str(part)] = value
    elif isinstance(node, list) and isinstance(part, int) and part < len(node):
        node[part] = value
    else:
        raise ConfigError(f"{place}: {explain.dotted(path)} cannot be set: no such item")


def _parsed(text: str, schema: explain.Schema | None) -> object:
    """Return the value that a text means, read as TOML where that is what the key takes."""
    quoted = len(text) > 1 and text[0] in "\"'" and text[-1] == text[0]
    if schema is not None and explain.takes_only_text(schema) and not quoted:
        return text
    if schema is not None and explain.takes_a_list(schema) and not text.startswith("["):
        return [_scalar(part.strip()) for part in text.split(",") if part.strip()]
    return _scalar(text)


def _scalar(text: str) -> object:
    try:
        table = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return table["value"] if len(table) == 1 else text


def _validated(merged: _Merged) -> Settings:
    try:
        return Settings.model_validate(merged.table)
    except ValidationError as error:
        found = explain.problems(error, merged.table)
        raise ConfigError(
            *(f"{merged.place_of(path)}: {sentence}" for path, sentence in found)
        ) from error


def _check_sites(settings: Settings, merged: _Merged) -> None:
    """Refuse a site whose turbine is not known, and two sites of one name."""
    seen: set[str] = set()
    for index, site in enumerate(settings.sites):
        path: explain.Path = ("sites", index)
        try:
            load_turbine(site.turbine, site.scale)
        except ConfigError as error:
            key = explain.dotted((*path, "turbine"))
            raise ConfigError(f"{merged.place_of((*path, 'turbine'))}: {key}: {error}") from error
        if site.name in seen:
            key = explain.dotted((*path, "name"))
            raise ConfigError(
                f"{merged.place_of((*path, 'name'))}: {key} = {site.name!r} is used twice"
            )
        seen.add(site.name)


def _leaves(value: object, path: explain.Path = ()) -> Iterator[tuple[explain.Path, object]]:
    """Yield the path and value of every leaf; a list of plain values is one leaf."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _leaves(inner, (*path, key))
    elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
        for index, inner in enumerate(value):
            yield from _leaves(inner, (*path, index))
    else:
        yield path, value
