"""`bladescout bench`: the tables of the README, measured here and now."""

from __future__ import annotations

import json
import sys
from datetime import UTC, datetime
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table as RichTable

from mission.cli.bench_angle import angle, cell
from mission.cli.bench_daemon import daemon
from mission.cli.bench_exposure import exposure
from mission.cli.bench_latency import latency
from mission.cli.bench_missions import missions
from mission.cli.bench_recording import recording
from mission.cli.bench_requests import requests
from mission.cli.bench_vehicle import vehicle
from mission.cli.typed import AsJson

app = typer.Typer(no_args_is_help=True, add_completion=False)


@app.callback()
def _bench() -> None:
    """Measure what the README states."""


app.command("angle")(angle)
app.command("daemon")(daemon)
app.command("exposure")(exposure)
app.command("latency")(latency)
app.command("recording")(recording)
app.command("requests")(requests)
app.command("vehicle")(vehicle)
app.command("missions")(missions)


@app.command("tracking")
def tracking(
    missions: Annotated[int, typer.Option(min=1, help="Whole inspections to fly.")] = 10,
    seed: Annotated[int, typer.Option(help="Draws turbines, angles, winds, everything.")] = 1,
    first: Annotated[int, typer.Option(min=0, help="Number of the first mission.")] = 0,
    processes: Annotated[int, typer.Option(min=1, help="Side by side, one a core.")] = 2,
    as_json: AsJson = False,
) -> None:
    """Fly whole inspections on a virtual clock and judge them by the true blades."""
    import benchmarks.tracking as bench

    notes = Console(stderr=True, highlight=False)
    done = []
    with notes.status(f"flying {missions} missions, seed {seed}") as status:
        for mission in bench.missions(missions, seed, first, processes):
            done.append(mission)
            status.update(f"{len(done)} of {missions} missions, seed {seed}")
    done.sort(key=lambda mission: mission.number)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    if as_json:
        sys.stdout.write(json.dumps(bench.as_json(done, seed, now)) + "\n")
        return
    out = Console(highlight=False, width=None if sys.stdout.isatty() else 200)
    grid = RichTable(
        title=f"Tracking, {missions} missions from {first}, seed {seed}, {now}",
        title_justify="left",
    )
    for heading in ("", "measured", "goal", "met"):
        grid.add_column(heading, justify="left" if not heading else "right")
    for row in bench.rows(done):
        met = "" if row.met is None else "yes" if row.met else "no"
        grid.add_row(row.name, cell(row.value, 3), row.goal, met)
    out.print(grid)
