"""What benchmarks have in common: the note while they measure, and how their rows are printed."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from mission.cli.exits import Exit, end

if TYPE_CHECKING:
    from benchmarks.latency import Machine
    from benchmarks.row import Row


@contextmanager
def measuring(words: str) -> Iterator[Callable[[str], None]]:
    """Say meanwhile what is done; end where the daemon or the simulated drone does not go on.

    Yields what tells of the next step.
    """
    from drivers.bus import BusUnreachable
    from mission.processes.simulation import SimulationFailed
    from mission.remote.client import NoReply

    try:
        with Console(stderr=True).status(words) as status:
            yield status.update
    except (SimulationFailed, BusUnreachable, NoReply) as error:
        end(Exit.DEVICE, str(error))


def goals_table(title: str, rows: Iterable[tuple[str, str, str, bool | None]]) -> Table:
    """Return a table of what was measured beside its goal; a row: name, measured, goal, met."""
    grid = Table(title=title, title_justify="left")
    for heading in ("", "measured", "goal", "met"):
        grid.add_column(heading, justify="left" if not heading else "right")
    for name, measured, goal, met in rows:
        grid.add_row(name, measured, goal, "" if met is None else "yes" if met else "no")
    return grid


def show_rows(
    name: str,
    title: str,
    asked: Mapping[str, float],
    rows: Sequence[Row],
    here: Machine,
    *,
    as_json: bool,
) -> None:
    """Print what ``bench name`` found; ``asked``: what it was told to measure, for the JSON."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    if as_json:
        answer = {
            "schema": f"bladescout/bench-{name}/1",
            "date": now,
            **asked,
            "machine": asdict(here),
            "rows": [asdict(row) for row in rows],
        }
        sys.stdout.write(json.dumps(answer) + "\n")
        return
    grid = Table(title=f"{title}, {now}", title_justify="left")
    grid.add_column("")
    for heading in ("", "goal"):
        grid.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        goal = "" if row.goal is None else f"{row.goal:g} {row.unit}"
        grid.add_row(row.name, f"{row.value:.1f} {row.unit}", goal)
    out = Console(highlight=False, width=None if sys.stdout.isatty() else 100)
    out.print(grid)
    out.print(f"{here.cpu}; load {here.load_1_min:.1f} (1 min) before", soft_wrap=True)
