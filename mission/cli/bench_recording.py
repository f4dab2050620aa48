"""`bladescout bench recording`: what recording a mission and reporting it cost."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table


def recording(
    seconds: Annotated[float, typer.Option(min=5, help="To feed the recorder, real time.")] = 30.0,
    photos: Annotated[int, typer.Option(min=12, help="In the report.")] = 300,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Show a recorder's share of a core with every sensor at full rate, and a large report."""
    from benchmarks.latency import machine
    from benchmarks.recording import measure

    here = machine()
    with Console(stderr=True).status("recording, then reporting"):
        rows = list(measure(seconds, photos))
    now = datetime.now(UTC).isoformat(timespec="seconds")
    if as_json:
        answer = {
            "schema": "bladescout/bench-recording/1",
            "date": now,
            "seconds": seconds,
            "machine": asdict(here),
            "rows": [asdict(row) for row in rows],
        }
        sys.stdout.write(json.dumps(answer) + "\n")
        return
    grid = Table(title=f"Recording for {seconds:g} s, {now}", title_justify="left")
    grid.add_column("")
    for heading in ("", "goal"):
        grid.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        goal = "" if row.goal is None else f"{row.goal:g} {row.unit}"
        grid.add_row(row.name, f"{row.value:.1f} {row.unit}", goal)
    out = Console(highlight=False, width=None if sys.stdout.isatty() else 100)
    out.print(grid)
    out.print(f"{here.cpu}; load {here.load_1_min:.1f} (1 min) before", soft_wrap=True)
