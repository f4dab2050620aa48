"""What a setting allows, in plain words; and what is wrong with one, in one sentence.

Both come from the JSON schema of the settings, so that a range is written once, in the model.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import TypeAlias, cast

from pydantic import ValidationError

from config.patterns import in_words
from config.settings import Settings

Schema: TypeAlias = Mapping[str, object]
Path = tuple[str | int, ...]


@lru_cache(maxsize=1)
def _root() -> Schema:
    return Settings.model_json_schema()


def dotted(path: Path) -> str:
    """Return the key as it is written after ``--set``: ``sites.0.turbine``."""
    return ".".join(str(part) for part in path) or "the file"


def schema_of(path: Path) -> Schema | None:
    """Return the schema of a key, or None where there is no such key."""
    node: Schema | None = _root()
    for part in path:
        node = _child(_resolved(node), part) if node is not None else None
    return None if node is None else _resolved(node)


def known_keys(path: Path) -> tuple[str, ...]:
    """Return the keys that a table knows."""
    return tuple(_mapping((schema_of(path) or {}).get("properties")))


def allowed(schema: Schema) -> str:
    """Return what a value must be: 'a number above 0 and at most 15'."""
    return " or ".join(dict.fromkeys(_alternatives(_resolved(schema))))


def description(path: Path) -> str:
    """Return what a key is for, in one paragraph; empty where its name says it."""
    node: Schema = _root()
    for part in path[:-1]:
        node = _resolved(_child(_resolved(node), part) or {})
    # Beside a reference: what the key is for, not what the table is in general.
    leaf = _child(_resolved(node), path[-1]) or {}
    words = leaf.get("description") or _resolved(leaf).get("description") or ""
    return " ".join(str(words).split())


def takes_only_text(schema: Schema) -> bool:
    """Return whether the key holds a string and nothing else."""
    return schema.get("type") == "string"


def takes_a_list(schema: Schema) -> bool:
    """Return whether the key holds a list."""
    return schema.get("type") == "array"


def problems(error: ValidationError, table: Mapping[str, object]) -> Iterator[tuple[Path, str]]:
    """Yield the key and one sentence about it for each thing that is wrong with ``table``."""
    seen: set[Path] = set()
    for one in error.errors(include_url=False):
        path = _key_of(one["loc"])
        if path in seen:  # a choice of types fails once for each of them
            continue
        seen.add(path)
        yield path, _sentence(path, one["type"], one["msg"], table)


def _sentence(path: Path, kind: str, message: str, table: Mapping[str, object]) -> str:
    key = dotted(path)
    if kind == "extra_forbidden":
        return f"{key} is not a known setting{_suggestion(path)}"
    must_be = allowed(schema_of(path) or {})
    if kind == "missing":
        return f"{key} is missing: it must be {must_be}"
    if kind == "value_error":
        return f"{key}: {message.removeprefix('Value error, ')}"
    return f"{key} = {_shown(_value_at(table, path))} is not allowed: it must be {must_be}"


def unknown(path: Path) -> str:
    """Return that there is no such key, and which one may be meant."""
    known = next((path[:n] for n in range(len(path), 0, -1) if schema_of(path[:n]) is not None), ())
    missing = path[: len(known) + 1]
    return f"{dotted(missing)} is not a known setting{_suggestion(missing)}"


def _suggestion(path: Path) -> str:
    known = known_keys(path[:-1])
    close = difflib.get_close_matches(str(path[-1]), known, n=1)
    if close:
        return f": did you mean {dotted((*path[:-1], close[0]))}?"
    return f" (known here: {', '.join(known)})" if known else ""


def _key_of(location: Sequence[str | int]) -> Path:
    """Return the part of a pydantic location that is a key; the rest names types of a choice."""
    path: Path = ()
    for part in location:
        longer = (*path, part)
        if schema_of(longer) is None and not _is_table(path):
            break
        path = longer
    return path


def _is_table(path: Path) -> bool:
    return "properties" in (schema_of(path) or {})


def _child(schema: Schema, part: str | int) -> Schema | None:
    if isinstance(part, int):
        items = schema.get("prefixItems")
        if isinstance(items, list):
            return cast("Schema", items[part]) if 0 <= part < len(items) else None
        item = schema.get("items")
        return cast("Schema", item) if isinstance(item, Mapping) else None
    child = _mapping(schema.get("properties")).get(part)
    return cast("Schema", child) if isinstance(child, Mapping) else None


def _resolved(schema: Schema) -> Schema:
    reference = schema.get("$ref")
    if not isinstance(reference, str):
        return schema
    return cast("Schema", _mapping(_root()["$defs"])[reference.rsplit("/", 1)[-1]])


def _mapping(value: object) -> Mapping[str, object]:
    return cast("Mapping[str, object]", value) if isinstance(value, Mapping) else {}


def _alternatives(schema: Schema) -> Iterator[str]:
    choices = schema.get("anyOf")
    if isinstance(choices, list):
        for choice in choices:
            yield from _alternatives(_resolved(cast("Schema", choice)))
    elif isinstance(words := schema.get("enum"), list):
        yield "one of " + ", ".join(repr(word) for word in words)
    elif "const" in schema:
        yield repr(schema["const"])
    elif schema.get("type") != "null":  # None is the absence of the key
        yield _plain(schema)


def _plain(schema: Schema) -> str:
    match schema.get("type"):
        case "number":
            return _ranged("a finite number", schema)
        case "integer":
            return _ranged("a whole number", schema)
        case "boolean":
            return "true or false"
        case "string":
            pattern = schema.get("pattern")
            return in_words(pattern) if isinstance(pattern, str) else "a text"
        case "array":
            return _list(schema)
        case _:
            return f"a table with {', '.join(_mapping(schema.get('properties')))}"


def _list(schema: Schema) -> str:
    exact = schema.get("prefixItems")
    if isinstance(exact, list):
        return f"a list of {len(exact)}, each {allowed(cast('Schema', exact[0]))}"
    item = schema.get("items")
    return f"a list, each {allowed(cast('Schema', item))}" if item else "a list"


def _ranged(noun: str, schema: Schema) -> str:
    bounds = (
        ("exclusiveMinimum", "above"),
        ("minimum", "at least"),
        ("exclusiveMaximum", "below"),
        ("maximum", "at most"),
    )
    words = [f"{word} {schema[key]:g}" for key, word in bounds if key in schema]
    return f"{noun} {' and '.join(words)}" if words else noun


def _value_at(table: object, path: Path) -> object:
    for part in path:
        if isinstance(table, Mapping):
            table = table.get(part)
        elif isinstance(table, list) and isinstance(part, int) and part < len(table):
            table = table[part]
    return table


def _shown(value: object) -> str:
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits; a deep nest
        return "a value too large to show"
    return text if len(text) <= 60 else text[:57] + "..."
