"""Exit codes, and the one way in which a command ends early: a sentence and a code."""

from __future__ import annotations

from enum import IntEnum
from typing import NoReturn

import typer

from mission.flight.command import MissionState


class Exit(IntEnum):
    """What the shell is told (design, What a person types)."""

    DONE = 0
    CONFIGURATION = 2
    REFUSED = 3
    UNFINISHED = 4
    DEVICE = 5
    FAILED = 6


_OF_STATE = {
    MissionState.COMPLETED: Exit.DONE,
    MissionState.REFUSED: Exit.REFUSED,
    MissionState.ENDED_SAFELY: Exit.UNFINISHED,
    MissionState.RELEASED: Exit.UNFINISHED,
    MissionState.FAILED: Exit.FAILED,
}


def exit_of(state: MissionState) -> Exit:
    """Return the code for how a mission ended."""
    return _OF_STATE.get(state, Exit.FAILED)


def end(code: Exit, sentence: str) -> NoReturn:
    """Print one sentence on standard error and leave with the code."""
    typer.secho("error: ", fg=typer.colors.RED, bold=True, nl=False, err=True)
    typer.echo(sentence, err=True)
    raise typer.Exit(int(code))
