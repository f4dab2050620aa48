"""`bladescout bench angle`: the ways to find the stop angle, compared on drawn turbines."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table as RichTable

from mission.cli.bench_rows import goals_table
from mission.cli.exits import Exit, end
from mission.cli.typed import AsJson

if TYPE_CHECKING:
    from benchmarks.angle import Table
    from benchmarks.angle_goals import Goal
    from benchmarks.angle_summary import Row

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
_ACTIVE = (
    ("n", "trials", 0),
    ("over 5 deg or refused", "failed_5", 0),
    ("looks", "looks_mean", 1),
    ("phase p95, s", "phase_p95_s", 0),
)


def angle(
    trials: Annotated[int, typer.Option(min=1, help="Scenes; pictures on every fifth.")] = 60,
    seed: Annotated[int, typer.Option(help="Of the first scene; the others follow.")] = 1000,
    effects: Annotated[
        bool,
        typer.Option(help="Rows of one effect each, fog and pitch, on every fourth scene."),
    ] = True,
    active: Annotated[
        int,
        typer.Option(min=0, help="Loops of re-centring from a prior 0-15 m wrong; 3000 is long."),
    ] = 300,
    core: Annotated[
        bool, typer.Option("--core", help="Only our fit and the paper's method: for many scenes.")
    ] = False,
    held_out: Annotated[
        bool,
        typer.Option(
            "--held-out", help="Only blades that neither the fit's prior nor its sigma comes from."
        ),
    ] = False,
    fog: Annotated[
        float, typer.Option(min=0, max=0.2, help="Extinction of every scene, per metre.")
    ] = 0.0,
    processes: Annotated[int, typer.Option(min=1, help="Side by side, one a core.")] = 2,
    keep: Annotated[
        Path | None, typer.Option(help="Append every outcome to a file, a line each.")
    ] = None,
    read: Annotated[
        list[Path] | None,
        typer.Option(help="Measure nothing: the table of what such files hold; can be repeated."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare the ways to find the stop angle: ten turbine models on five sites, and weather."""
    from benchmarks.angle import Table, measure
    from benchmarks.angle_goals import goals
    from benchmarks.angle_kept import read_trials
    from benchmarks.angle_scenes import SceneOptions
    from benchmarks.blade_family import HELD_OUT

    table = Table()
    if read:
        try:
            table.merge(Table(read_trials(read)))
        except OSError as error:
            end(Exit.CONFIGURATION, f"--read {error.filename}: {error.strerror}")
        except ValueError:
            end(Exit.CONFIGURATION, f"--read {read[-1]}: holds other lines than --keep writes")
    else:
        options = SceneOptions(models=HELD_OUT if held_out else None, fog_per_m=fog)
        with Console(stderr=True, highlight=False).status("drawing scenes") as status:
            for done in measure(
                table,
                trials,
                seed,
                options,
                effects=effects and not core,
                active=active,
                processes=processes,
                core=core,
                keep=keep,
            ):
                status.update(f"{done} of {trials + active} scenes and loops")
    now = datetime.now(UTC).isoformat(timespec="seconds")
    seeds = table.seeds()
    reached = [] if fog else goals(table)  # set for clear air
    if as_json:
        answer = {
            "schema": "bladescout/bench-angle/1",
            "date": now,
            "seeds": seeds,
            "held_out": held_out,
            "fog_per_m": fog,
            "rows": table.rows(),
            "strata": table.strata(),
            "models": table.by(lambda trial: trial.model),
            "sites": table.by(lambda trial: trial.site),
            "goals": [goal._asdict() | {"met": goal.met} for goal in reached],
        }
        sys.stdout.write(json.dumps(answer) + "\n")
        return
    _show(table, reached, f"seeds {seeds[0]}-{seeds[1]}, fog {fog:g} /m, {now}")


def _show(table: Table, reached: list[Goal], subtitle: str) -> None:
    from benchmarks.angle import ACTIVE, NOMINAL, PASSIVE

    out = Console(highlight=False, width=None if sys.stdout.isatty() else 200)
    rows = table.rows()
    out.print(f"Stop angle, errors in degrees; {subtitle}", soft_wrap=True)
    nominal = {name: row for name, row in rows.items() if name in NOMINAL}
    out.print(_grid("nominal conditions", nominal, _COLUMNS))
    others = {name: row for name, row in rows.items() if name not in NOMINAL}
    if others:
        out.print(_grid("one thing changed", others, _COLUMNS))
    fits = {name: row for name, row in rows.items() if row["sigma_median_deg"] is not None}
    out.print(_grid("of the fits", fits, _OF_FIT))
    loops = {name: rows[name] for name in (PASSIVE, ACTIVE) if name in rows}
    if loops:
        out.print(_grid("prior error of 0-15 m", loops, _ACTIVE))
    out.print(_crossed("by model: mean, within 5 deg", table.by(lambda trial: trial.model)))
    out.print(_crossed("by site: mean, within 5 deg", table.by(lambda trial: trial.site)))
    if reached:
        out.print(_of_goals(reached))


def _crossed(title: str, groups: Mapping[str, Mapping[str, Row]]) -> RichTable:
    grid = RichTable(title=title, title_justify="left")
    grid.add_column("")
    names = list(dict.fromkeys(name for rows in groups.values() for name in rows))
    for name in names:
        short = name.partition(" (our")[0].replace(", 60 deg window, 1 s", "")
        grid.add_column(short.replace("full azimuth, ", ""), justify="right")
    for group, rows in groups.items():
        told = [rows.get(name, {}) for name in names]
        grid.add_row(
            group, *(f"{cell(r.get('mean_deg'), 2)}, {cell(r.get('success_5'), 2)}" for r in told)
        )
    return grid


def _of_goals(reached: list[Goal]) -> RichTable:
    def bounds(goal: Goal) -> str:
        if goal.least <= 0:
            return f"<= {goal.most:g}"
        return f"{goal.least:g} to {goal.most:g}"

    told = ((goal.what, cell(goal.measured, 4), bounds(goal), goal.met) for goal in reached)
    return goals_table("goals", told)


def _grid(title: str, rows: dict[str, Row], columns: tuple[tuple[str, str, int], ...]) -> RichTable:
    grid = RichTable(title=title, title_justify="left")
    grid.add_column("")
    for heading, _, _ in columns:
        grid.add_column(heading, justify="right")
    for name, row in rows.items():
        grid.add_row(name, *(cell(row.get(key), digits) for _, key, digits in columns))
    return grid


def cell(value: float | None, digits: int) -> str:
    """Return a figure as a table shows it, a dash where there is none."""
    return "-" if value is None else f"{value:.{digits}f}"
