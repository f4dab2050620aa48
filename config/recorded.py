"""Settings as a mission left them, read by a later version."""

from __future__ import annotations

import copy
import operator
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from config.settings import Settings


def recorded_settings(table: Mapping[str, object]) -> tuple[Settings, tuple[str, ...]]:
    """Return the settings of a table, and the dotted keys that this version no longer has.

    A key that is not known is refused where a person types it; what a mission was flown with must
    stay readable. Raises `pydantic.ValidationError` for whatever else is amiss.
    """
    known = copy.deepcopy(dict(table))
    gone: list[str] = []
    while True:
        try:
            return Settings.model_validate(known), tuple(gone)
        except ValidationError as error:
            amiss = error.errors(include_url=False)
            unknown = [one["loc"] for one in amiss if one["type"] == "extra_forbidden"]
            if not unknown or len(unknown) < len(amiss):
                raise
            for place in unknown:
                _drop(known, place)
                gone.append(".".join(str(part) for part in place))


def _drop(table: Any, place: tuple[int | str, ...]) -> None:
    """Take a key out of the tables and lists that hold it; pydantic has just named it."""
    for part in place[:-1]:
        table = operator.getitem(table, part)
    operator.delitem(table, place[-1])
