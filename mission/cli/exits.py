"""Exit codes, and the one way in which a command ends early: a sentence and a code."""

from __future__ import annotations

from enum import IntEnum
from typing import NoReturn

import typer
from rich.console import Console
from rich.markup import escape

from mission.flight.command import MissionState


class Exit(IntEnum):
    """What the shell is told (design, What a person types)."""

    DONE = 0
    CONFIGURATION = 2
    REFUSED = 3
    UNFINISHED = 4
    DEVICE = 5
    FAILED = 6


EXIT_OF_STATE = {
    MissionState.COMPLETED: Exit.DONE,
    MissionState.REFUSED: Exit.REFUSED,
    MissionState.ENDED_SAFELY: Exit.UNFINISHED,
    MissionState.RELEASED: Exit.UNFINISHED,
    MissionState.FAILED: Exit.FAILED,
}

errors = Console(stderr=True, highlight=False)


def end(code: Exit, sentence: str) -> NoReturn:
    """Print one sentence on standard error and leave with the code."""
    errors.print(f"[bold red]error:[/] {escape(sentence)}", soft_wrap=True)
    raise typer.Exit(int(code))
