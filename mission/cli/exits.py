"""Exit codes, and the one way in which a command ends early: a sentence and a code."""

from __future__ import annotations

import json
import os
import sys
from contextvars import ContextVar
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


_json_wanted: ContextVar[bool] = ContextVar("json_wanted", default=False)


def want_json(wanted: bool) -> bool:
    """Remember whether the command that runs was asked for ``--json``; the option's callback."""
    _json_wanted.set(wanted)
    return wanted


def end(code: Exit, sentence: str) -> NoReturn:
    """Print one sentence as `tell` does and leave with the code."""
    tell(code, sentence)
    raise typer.Exit(int(code))


def tell(code: Exit, sentence: str) -> None:
    """Print on standard error, in one sentence, why a command ends with the code.

    Who asked for ``--json`` is told on standard output, too: ``{"ok": false, "exit_code": 5,
    "error": "..."}``.
    """
    plain = "NO_COLOR" in os.environ or os.environ.get("TERM") == "dumb"
    word = typer.style("error: ", fg=typer.colors.RED, bold=True)
    # Where standard error is no terminal, the library takes the colour off by itself.
    typer.echo(word + sentence, err=True, color=False if plain else None)
    if _json_wanted.get():
        told = {"ok": False, "exit_code": int(code), "error": sentence}
        sys.stdout.write(json.dumps(told) + "\n")
