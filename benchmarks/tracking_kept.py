"""Missions of the tracking bench kept in a file, a line each, so that a long run goes on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter

from benchmarks.tracking import Mission


@dataclass(frozen=True, slots=True)
class _Kept:
    seed: int
    mission: Mission


_LINE = TypeAdapter(_Kept)


def keep_missions(path: Path, seed: int, flown: Iterable[Mission]) -> Iterator[Mission]:
    """Yield missions as they are flown, each appended to a file before.

    A last line that was cut short is thrown away.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists():
        whole = path.read_bytes()
        path.write_bytes(whole[: whole.rfind(b"\n") + 1])
    for mission in flown:
        with path.open("ab") as file:
            file.write(_LINE.dump_json(_Kept(seed, mission)) + b"\n")
        yield mission


def read_missions(path: Path, seed: int) -> dict[int, Mission]:
    """Return what a file holds of a seed by the mission's number; nothing where there is no file.

    A last line that was cut short is passed over. Raises ``ValueError`` where another is no
    mission.
    """
    if not path.exists():
        return {}
    lines = path.read_bytes().split(b"\n")
    kept = [_LINE.validate_json(line) for line in lines[:-1] if line]
    return {one.mission.number: one.mission for one in kept if one.seed == seed}
