"""Outcomes of the angle bench kept in a file, so that a long run can be flown in parts and summed.

A line an outcome: `{"row": name of the row, "trial": {the fields of a Trial}}`, appended as each
scene is done; a run that is cut short keeps what it has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter

from benchmarks.angle_trials import Trial


@dataclass(frozen=True, slots=True)
class KeptTrial:
    """One line of a file."""

    row: str
    trial: Trial


_LINE = TypeAdapter(KeptTrial)


def keep_trials(path: Path, rows: Mapping[str, Sequence[Trial]]) -> None:
    """Append the outcomes of rows to a file."""
    lines = [KeptTrial(name, trial) for name, trials in rows.items() for trial in trials]
    with path.open("ab") as file:
        file.writelines(_LINE.dump_json(line) + b"\n" for line in lines)


def read_trials(paths: Sequence[Path]) -> dict[str, list[Trial]]:
    """Return the outcomes of files by row; a scene kept twice counts once, as it was kept last.

    Raises ``ValueError`` where a line is not an outcome.
    """
    rows: dict[str, dict[int, Trial]] = {}
    for path in paths:
        for line in path.read_bytes().splitlines():
            kept = _LINE.validate_json(line)
            rows.setdefault(kept.row, {})[kept.trial.seed] = kept.trial
    return {name: list(trials.values()) for name, trials in rows.items()}
