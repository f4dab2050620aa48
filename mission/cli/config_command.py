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
