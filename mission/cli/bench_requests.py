"""`bladescout bench requests`: how soon requests are answered, and what they cost."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table


def requests(
    count: Annotated[int, typer.Option(min=20, help="Requests of each kind.")] = 400,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Show how soon requests are answered, what a flood costs, and 200 vehicles at once."""
    from benchmarks.latency import machine
    from benchmarks.requests import measure

    here = machine()
    with Console(stderr=True).status("asking"):
        rows = list(measure(count))
    now = datetime.now(UTC).isoformat(timespec="seconds")
    if as_json:
        answer = {
            "schema": "bladescout/bench-requests/1",
            "date": now,
            "count": count,
            "machine": asdict(here),
            "rows": [asdict(row) for row in rows],
        }
        sys.stdout.write(json.dumps(answer) + "\n")
        return
    grid = Table(title=f"{count} requests of each kind, {now}", title_justify="left")
    grid.add_column("")
    for heading in ("", "goal"):
        grid.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        goal = "" if row.goal is None else f"{row.goal:g} {row.unit}"
        grid.add_row(row.name, f"{row.value:.1f} {row.unit}", goal)
    out = Console(highlight=False, width=None if sys.stdout.isatty() else 100)
    out.print(grid)
    out.print(f"{here.cpu}; load {here.load_1_min:.1f} (1 min) before", soft_wrap=True)
