"""One figure of a benchmark's table."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Row:
    """One figure beside its goal (the most that is allowed); None: no goal."""

    name: str
    value: float
    unit: str
    goal: float | None = None
