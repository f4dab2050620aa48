"""`bladescout bench vehicle`: the simulated vehicle beside the measured PX4."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from mission.cli.typed import AsJson


def vehicle(
    seed: Annotated[int, typer.Option(help="Draws wind and position error of the hovers.")] = 1,
    as_json: AsJson = False,
) -> None:
    """Show how the simulated vehicle flies, beside what PX4 was measured to do."""
    from benchmarks.vehicle import measure

    rows = list(measure(seed))
    now = datetime.now(UTC).isoformat(timespec="seconds")
    if as_json:
        answer = {
            "schema": "bladescout/bench-vehicle/1", "date": now, "seed": seed,
            "rows": [asdict(row) for row in rows],
        }  # fmt: skip
        sys.stdout.write(json.dumps(answer) + "\n")
        return
    grid = Table(title=f"The simulated vehicle; seed {seed}, {now}", title_justify="left")
    grid.add_column("")
    grid.add_column("here", justify="right")
    grid.add_column("PX4 v1.17", justify="right")
    grid.add_column("")
    for row in rows:
        grid.add_row(row.name, f"{row.value:.2f}", row.px4, row.unit)
    Console(highlight=False).print(grid)
