"""Where two recorded values differ: the first field, by its path."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass


@dataclass(frozen=True, slots=True)
class Difference:
    """One field of one tick that did not come out as recorded."""

    tick: int
    mission_s: float
    field: str
    recorded: object
    recomputed: object

    def words(self) -> str:
        """Return the difference as a sentence."""
        return (
            f"tick {self.tick} at {self.mission_s:.2f} s: {self.field} was recorded as "
            f"{self.recorded!r} and recomputed as {self.recomputed!r}"
        )


def first_difference(
    recorded: object, recomputed: object, path: str = ""
) -> tuple[str, object, object] | None:
    """Return (path, recorded, recomputed) of the first field that differs, or None.

    Numbers are equal when they are the same number; not a number equals itself.
    """
    if is_dataclass(recorded) and type(recorded) is type(recomputed):
        for field in fields(recorded):
            mine, theirs = getattr(recorded, field.name), getattr(recomputed, field.name)
            found = first_difference(mine, theirs, f"{path}.{field.name}" if path else field.name)
            if found is not None:
                return found
        return None
    if isinstance(recorded, list | tuple) and isinstance(recomputed, list | tuple):
        if len(recorded) != len(recomputed):
            return path, recorded, recomputed
        for index, (mine, theirs) in enumerate(zip(recorded, recomputed, strict=True)):
            found = first_difference(mine, theirs, f"{path}[{index}]")
            if found is not None:
                return found
        return None
    if isinstance(recorded, Mapping) and isinstance(recomputed, Mapping):
        for key in sorted({*recorded, *recomputed}, key=str):
            place = f"{path}.{key}" if path else str(key)
            found = first_difference(recorded.get(key), recomputed.get(key), place)
            if found is not None:
                return found
        return None
    if isinstance(recorded, float) and isinstance(recomputed, float) and math.isnan(recorded):
        return None if math.isnan(recomputed) else (path, recorded, recomputed)
    return None if recorded == recomputed else (path, recorded, recomputed)
