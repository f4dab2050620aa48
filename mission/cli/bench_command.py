"""`bladescout bench`: the tables of the README, measured here and now."""

from __future__ import annotations

import json
import sys
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table as RichTable

from mission.cli.bench_latency import latency
from mission.cli.bench_missions import missions
from mission.cli.bench_vehicle import vehicle

if TYPE_CHECKING:
    from benchmarks.angle import Table
    from benchmarks.angle_summary import Row

app = typer.Typer(no_args_is_help=True, add_completion=False)

#: Heading, key, decimals of the printed columns.
_COLUMNS = (
    ("n", "trials", 0),
    ("refused", "refused", 0),
    ("mean", "mean_deg", 3),
    ("95 % CI from", "mean_low", 3),
    ("to", "mean_high", 3),
    ("p95", "p95_deg", 2),
    ("max", "max_deg", 2),
    ("<=5 deg", "success_5", 4),
    ("<=1 deg", "success_1", 4),
    ("bias", "bias_deg", 3),
    ("ms", "ms_median", 0),
)
_OF_FIT = (
    ("sigma", "sigma_median_deg", 2),
    ("in 1 s.", "within_1_sigma", 3),
    ("in 2 s.", "within_2_sigma", 3),
    ("over 4 s.", "beyond_4_sigma", 4),
    ("hub across p95", "across_p95_m", 3),
    ("along p95", "along_p95_m", 3),
    ("normal p95", "normal_p95_deg", 2),
    ("pitch p95", "pitch_p95_deg", 1),
    ("pitch max", "pitch_max_deg", 0),
    ("unknown", "pitch_unknown", 3),
)


@app.callback()
def _bench() -> None:
    """Measure what the README states."""


app.command("latency")(latency)
app.command("vehicle")(vehicle)
app.command("missions")(missions)


@app.command("angle")
def angle(
    trials: Annotated[int, typer.Option(min=1, help="Scenes; pictures on every fifth.")] = 60,
    seed: Annotated[int, typer.Option(help="Of the first scene; the others follow.")] = 1000,
    effects: Annotated[
        bool, typer.Option(help="Rows that leave out one effect, and fog, on every fourth scene.")
    ] = True,
    held_out: Annotated[
        bool,
        typer.Option(
            "--held-out", help="Only blades that neither the fit's prior nor its sigma comes from."
        ),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Compare the ways to find the stop angle, on drawn turbines and looks."""
    from benchmarks.angle import Table, measure
    from benchmarks.angle_scenes import SceneOptions
    from benchmarks.blade_family import HELD_OUT

    options = SceneOptions(models=HELD_OUT if held_out else None)
    notes = Console(stderr=True, highlight=False)
    table = Table()
    with notes.status("drawing scenes") as status:
        for done in measure(table, trials, seed, options, effects=effects):
            status.update(f"scene {done} of {trials}")
    now = datetime.now(UTC).isoformat(timespec="seconds")
    seeds = [seed, seed + trials - 1]
    if as_json:
        answer = {
            "schema": "bladescout/bench-angle/1",
            "date": now,
            "seeds": seeds,
            "held_out": held_out,
            "rows": table.rows(),
            "strata": table.strata(),
        }
        sys.stdout.write(json.dumps(answer) + "\n")
        return
    _show(table, f"seeds {seeds[0]}-{seeds[1]}, {now}")


@app.command("tracking")
def tracking(
    missions: Annotated[int, typer.Option(min=1, help="Whole inspections to fly.")] = 10,
    seed: Annotated[int, typer.Option(help="Draws turbines, angles, winds, everything.")] = 1,
    first: Annotated[int, typer.Option(min=0, help="Number of the first mission.")] = 0,
    processes: Annotated[int, typer.Option(min=1, help="Side by side, one a core.")] = 2,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
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
        grid.add_row(row.name, _cell(row.value, 3), row.goal, met)
    out.print(grid)


def _show(table: Table, subtitle: str) -> None:
    out = Console(highlight=False, width=None if sys.stdout.isatty() else 200)
    rows = table.rows()
    out.print(f"Stop angle, errors in degrees; {subtitle}", soft_wrap=True)
    out.print(_grid("all pitches", rows, _COLUMNS))
    fits = {name: row for name, row in rows.items() if row["sigma_median_deg"] is not None}
    out.print(_grid("of the fits", fits, _OF_FIT))
    for name, parts in table.strata().items():
        if len(table.trials[name]) == max(len(t) for t in table.trials.values()):
            out.print(_grid(f"{name}, by pitch", parts, _COLUMNS))


def _grid(title: str, rows: dict[str, Row], columns: tuple[tuple[str, str, int], ...]) -> RichTable:
    grid = RichTable(title=title, title_justify="left")
    grid.add_column("")
    for heading, _, _ in columns:
        grid.add_column(heading, justify="right")
    for name, row in rows.items():
        cells = [_cell(row.get(key), digits) for _, key, digits in columns]
        grid.add_row(name, *cells)
    return grid


def _cell(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
