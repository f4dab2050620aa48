"""`bladescout config`: show every setting and where it comes from; check a file."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mission.cli.exits import Exit, end
from mission.cli.typed import AsJson

if TYPE_CHECKING:
    from rich.table import Table

    from config.sources import Loaded

app = typer.Typer(no_args_is_help=True, add_completion=False)


@app.command()
def show(
    config: Annotated[
        list[Path] | None, typer.Option(help="A settings file; later ones win.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="section.key=value, as in a file.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show the value of every setting and where it comes from."""
    from rich.console import Console

    from config.sources import ConfigError, load

    try:
        loaded = load(config or [], set_ or [])
    except ConfigError as error:
        end(Exit.CONFIGURATION, str(error))
    if as_json:
        sys.stdout.write(json.dumps(_as_object(loaded)) + "\n")
    else:
        # Elsewhere than on a terminal nothing is folded: a line stays a setting.
        Console(width=None if sys.stdout.isatty() else 400).print(_as_table(loaded))


@app.command()
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A settings file or scenario.")],
) -> None:
    """Check a file by itself: exit 0 when every value can be used, else 2 and say why not."""
    from config.sources import ConfigError, load

    try:
        load([file], environment={})
    except ConfigError as error:
        end(Exit.CONFIGURATION, str(error))
    typer.echo(f"{file}: every value can be used")


@app.command()
def explain(
    key: Annotated[
        str, typer.Argument(metavar="KEY", help="A setting, as guard.max_lead_m; or a section.")
    ],
    as_json: AsJson = False,
) -> None:
    """Say what a setting is for, what it may be, its default; of a section, of all its keys."""
    from config import explain
    from config.settings import Settings

    path = tuple(int(part) if part.isdecimal() else part for part in key.split("."))
    schema = explain.schema_of(path)
    if schema is None:
        end(Exit.CONFIGURATION, explain.unknown(path))
    defaults = Settings().model_dump(mode="json")
    keys = [(*path, name) for name in explain.known_keys(path)] or [path]
    told = [_explained(one, defaults) for one in keys]
    if as_json:
        sys.stdout.write(json.dumps({"settings": told}) + "\n")
        return
    if len(keys) > 1:
        typer.echo(f"{key}: {explain.description(path)}\n")
    for one in told:
        typer.echo(f"{one['key']}" + (f": {one['description']}" if one["description"] else ""))
        typer.echo(
            f"  {one['allowed']}" + (f"; default {one['default']}" if "default" in one else "")
        )


def _explained(path: tuple[str | int, ...], defaults: object) -> dict[str, str]:
    from config import explain

    schema = explain.schema_of(path) or {}
    told = {
        "key": explain.dotted(path),
        "description": explain.description(path),
        "allowed": explain.allowed(schema),
    }
    value = defaults
    for part in path:
        if not isinstance(value, dict) or part not in value:
            return told  # of an item of a list there is no default
        value = value[part]
    return told if isinstance(value, dict) else told | {"default": json.dumps(value)}


def _as_object(loaded: Loaded) -> dict[str, object]:
    return {
        "settings": loaded.settings.model_dump(mode="json"),
        "places": {key: place for key, _, place in loaded.leaves()},
    }


def _as_table(loaded: Loaded) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    from config.sources import DEFAULT

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("setting", no_wrap=True)
    table.add_column("value", overflow="fold")
    table.add_column("from", overflow="fold")
    section = ""
    for key, value, place in loaded.leaves():
        if "." in key and key.partition(".")[0] != section:
            section = key.partition(".")[0]
            table.add_section()
        style = "dim" if place == DEFAULT else "bold"
        words = value if isinstance(value, str) else json.dumps(value)
        table.add_row(Text(key), Text(words, style), Text(place, style))
    return table
