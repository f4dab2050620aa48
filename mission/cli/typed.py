"""What is typed after options of several parts, read; a mistake ends with one sentence."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from mission.cli.exits import Exit, end, want_json

if TYPE_CHECKING:
    from pydantic import ValidationError

#: Of every command that has an answer: one object on standard output, whatever comes of it.
AsJson = Annotated[
    bool,
    typer.Option("--json", callback=want_json, help="Print one JSON object, and nothing else."),
]

#: Of the commands that play the world, flown or not.
Seed = Annotated[
    int | None,
    typer.Option(help="Draws stop angle, pitch, yaw, launch point; else as the scenario says."),
]
Speed = Annotated[
    str | None,
    typer.Option(help="Times real time, 0 to 20; or auto: as fast as this computer can, 1-5."),
]
SetAgain = Annotated[
    list[str] | None,
    typer.Option("--set", help="section.key=value, as in a file; may be given again."),
]


def asked_text(option: str, given: str, question: str) -> str:
    """Return what was given, or what is answered where somebody sits at a terminal."""
    if given:
        return given
    _need_terminal(option)
    return str(typer.prompt(question, err=True, prompt_suffix=" "))


def asked_word(option: str, given: bool, question: str) -> bool:
    """Return that the word was given, now or before; end where somebody who is asked denies it."""
    if not given:
        _need_terminal(option)
        if not typer.confirm(question, err=True, prompt_suffix=" "):
            end(
                Exit.REFUSED,
                "nothing was started: whoever starts a mission gives their word for it",
            )
    return True


def mission_typed(place: Path) -> Path:
    """Return the place of a mission that was named, or end where it can be none."""
    if not place.exists():
        end(Exit.CONFIGURATION, f"{place}: there is no such folder")
    inside = sorted(place.glob("*/mission.json")) if place.is_dir() else []
    if inside and not (place / "mission.json").exists():
        newest = inside[-1].parent
        end(Exit.CONFIGURATION, f"{place} holds {len(inside)} missions: name one, as {newest}")
    return place


def mistyped(error: ValidationError, options: Mapping[str, str]) -> NoReturn:
    """End with the first thing that is wrong with a request, by the option that it was typed for.

    ``options``: of each field that has one.
    """
    from config.errors import first_fault

    field = str(error.errors(include_url=False)[0]["loc"][0])
    words = first_fault(error, found=True)
    option = options.get(field)
    if option is not None:
        words = re.sub(r"^[^ ]+", option, words, count=1)
    end(Exit.CONFIGURATION, words)


def _need_terminal(option: str) -> None:
    if not sys.stdin.isatty():
        end(Exit.CONFIGURATION, f"{option} is missing, and nobody is there to be asked")


def blades_typed(text: str) -> tuple[tuple[str, ...] | None, dict[str, str]]:
    """Return the blades to fly and their serials from ``A,C`` or ``A=LM-1,B=LM-2,C=LM-3``.

    No text: None (as configured). Where serials are given, all blades of the configuration are
    flown: a serial names a blade, it does not choose it.
    """
    if not text:
        return None, {}
    names: list[str] = []
    serials: dict[str, str] = {}
    for part in text.split(","):
        name, equals, serial = part.strip().partition("=")
        if equals:
            serials[name.upper()] = serial
        else:
            names.append(name.upper())
    if names and serials:
        end(Exit.CONFIGURATION, f"--blades {text!r}: either names, or a serial for each")
    return (tuple(names) or None), serials


def numbers_typed(option: str, text: str, count: int) -> tuple[float, ...] | None:
    """Return numbers written with commas between, the last ones 0 where left out; None: no text."""
    if not text:
        return None
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        end(Exit.CONFIGURATION, f"{option} {text!r}: write numbers with commas between")
    if not count - 1 <= len(numbers) <= count:
        end(Exit.CONFIGURATION, f"{option} {text!r}: {count - 1} or {count} numbers are wanted")
    return tuple([*numbers, 0.0][:count])
