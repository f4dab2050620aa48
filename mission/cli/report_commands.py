"""`bladescout report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mission.cli import photo_commands
from mission.cli.exits import Exit, end


def report(
    folder: Annotated[Path, typer.Argument(help="A mission folder.")],
) -> None:
    """Render a mission's report again."""
    from mission.records.report import NotAMission, write_report

    try:
        path = write_report(folder)
    except NotAMission as error:
        end(Exit.CONFIGURATION, str(error))
    typer.echo(f"report: {path}")


def mount(app: typer.Typer) -> None:
    """Add the commands about finished missions to the command line."""
    app.command()(report)
    photo_commands.mount(app)
