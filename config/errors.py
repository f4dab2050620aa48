"""The one error of this package: a setting that cannot be used, said in one sentence."""

from __future__ import annotations

import re
from typing import cast

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from config.patterns import in_words


class ConfigError(ValueError):
    """A file, variable or option holds something that cannot be used.

    The text is meant for the person who wrote it: where it stands, which key, what was found
    and what is allowed. Several problems make several lines.
    """

    def __init__(self, *problems: str) -> None:
        self.problems = problems
        super().__init__("\n".join(problems))


def first_fault(error: ValidationError, *, whole: str = "", found: bool = False) -> str:
    """Return where the first thing that is wrong stands, and what: ``turbines.0.name: ...``.

    ``whole``: how what was read is called where it is wrong as a whole. ``found``: with the value
    that was found, for what somebody has just typed.
    """
    fault = error.errors(include_url=False)[0]
    where = ".".join(str(part) for part in fault["loc"] if part != "[key]") or whole
    if found and fault["type"] != "missing":
        where = f"{where} {fault['input']!r}"
    return f"{where}: {_words(fault)}" if where else _words(fault)


def _words(fault: ErrorDetails) -> str:
    """Return what is wrong, as this product says it: ``must be less than 360``."""
    if fault["type"] == "missing":
        return "is missing"
    if fault["type"] == "string_pattern_mismatch":
        return f"must be {in_words(cast('str', fault['ctx']['pattern']))}"
    words = fault["msg"].removeprefix("Value error, ")
    return re.sub(r"^(Input|String) should\b", "must", words)
