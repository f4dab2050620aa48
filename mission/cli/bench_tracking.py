"""`bladescout bench tracking`: whole inspections judged by the true blades, in one table."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from mission.cli.bench_angle import cell
from mission.cli.bench_rows import goals_table
from mission.cli.simulate_command import make_room
from mission.cli.typed import AsJson

if TYPE_CHECKING:
    from benchmarks.tracking import Mission, Row
    from benchmarks.tracking_wire import Wired


def tracking(
    missions: Annotated[int, typer.Option(min=1, help="Whole inspections to fly.")] = 10,
    seed: Annotated[int, typer.Option(help="Draws turbines, angles, winds, everything.")] = 1,
    first: Annotated[int, typer.Option(min=0, help="Number of the first mission.")] = 0,
    processes: Annotated[int, typer.Option(min=1, help="Side by side, one a core.")] = 2,
    keep: Annotated[
        Path | None,
        typer.Option(
            dir_okay=False,
            help="File that keeps each mission as it is done: what it has is not flown.",
        ),
    ] = None,
    wire: Annotated[
        bool, typer.Option(help="In real processes, one after the other, as simulate flies.")
    ] = False,
    out: Annotated[Path, typer.Option(help="Folder of the missions, with --wire.")] = Path(
        "missions/bench"
    ),
    as_json: AsJson = False,
) -> None:
    """Fly whole inspections on a virtual clock and judge them by the true blades."""
    numbers = range(first, first + missions)
    title = f"{missions} missions from {first}, seed {seed}"
    if wire:
        _on_the_wire(seed, numbers, out, title, as_json=as_json)
        return
    import benchmarks.tracking as bench

    flown = _in_memory(seed, numbers, processes, keep)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    if as_json:
        sys.stdout.write(json.dumps(bench.as_json(flown, seed, now)) + "\n")
    else:
        _show(bench.rows(flown), f"Tracking, {title}, {now}")


def _in_memory(
    seed: int, numbers: Sequence[int], processes: int, keep: Path | None
) -> list[Mission]:
    import benchmarks.tracking as bench
    from benchmarks.tracking_kept import keep_missions, read_missions

    try:
        kept = {} if keep is None else read_missions(keep, seed)
    except ValueError as error:
        message = f"{keep}: not what --keep writes; name another file"
        raise typer.BadParameter(message, param_hint="--keep") from error
    flown = [mission for number, mission in kept.items() if number in numbers]
    left = [number for number in numbers if number not in kept]
    notes = Console(stderr=True, highlight=False)
    with notes.status(f"flying {len(left)} missions, seed {seed}") as status:
        fresh = bench.missions(left, seed, processes)
        for mission in fresh if keep is None else keep_missions(keep, seed, fresh):
            flown.append(mission)
            status.update(f"{len(flown)} of {len(numbers)} missions, seed {seed}")
    return sorted(flown, key=lambda mission: mission.number)


def _on_the_wire(
    seed: int, numbers: Sequence[int], out: Path, title: str, *, as_json: bool
) -> None:
    from benchmarks.tracking_wire import fly, rows

    make_room(out, None)
    notes = Console(stderr=True, highlight=False)
    flown: list[Wired] = []
    for one in fly(seed, numbers, out):
        flown.append(one)
        words = f"{len(flown)} of {len(numbers)}: {one.model}, {one.wind}, {one.profile}: "
        notes.print(f"{words}{one.state}, {one.words}", soft_wrap=True)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    if as_json:
        whole = {
            "schema": "bladescout/bench-tracking-wire/1", "date": now, "seed": seed,
            "missions": [_brief(one) for one in flown],
            "rows": [asdict(row) for row in rows(flown)],
        }  # fmt: skip
        sys.stdout.write(json.dumps(whole) + "\n")
    else:
        _show(rows(flown), f"Tracking in real processes, {title}, {now}")


def _brief(one: Wired) -> dict[str, object]:
    parts = {"duration_s", "swaps", "passes", "errors", "truth"}
    told = None if one.told is None else one.told.model_dump(mode="json", include=parts)
    drawn = {"number": one.number, "model": one.model, "wind": one.wind, "profile": one.profile}
    return {**drawn, "state": one.state, "words": one.words, "told": told}


def _show(rows: Sequence[Row], title: str) -> None:
    out = Console(highlight=False, width=None if sys.stdout.isatty() else 200)
    told = ((row.name, cell(row.value, 3), row.goal, row.met) for row in rows)
    out.print(goals_table(title, told))
