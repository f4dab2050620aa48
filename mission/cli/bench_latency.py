"""`bladescout bench latency`: what each step of perception takes."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from mission.cli.typed import AsJson

if TYPE_CHECKING:
    from benchmarks.latency import Machine, Row


def latency(
    repeats: Annotated[int, typer.Option(min=3, help="Of each step; slow ones fewer.")] = 100,
    seed: Annotated[int, typer.Option(help="Draws the turbine.")] = 1,
    as_json: AsJson = False,
) -> None:
    """Show what each step of perception takes, beside its goal."""
    from benchmarks.latency import machine, measure

    here = machine()
    notes = Console(stderr=True, highlight=False)
    rows: list[Row] = []
    with notes.status("casting a second of scan") as status:
        for row in measure(repeats, seed):
            rows.append(row)
            status.update(f"after: {row.name.strip()}")
    now = datetime.now(UTC).isoformat(timespec="seconds")
    if as_json:
        answer = {
            "schema": "bladescout/bench-latency/1",
            "date": now,
            "seed": seed,
            "repeats": repeats,
            "machine": asdict(here),
            "rows": [
                {**asdict(row), "name": row.name.strip(), "met": row.met,
                 "times_real": row.times_real}
                for row in rows
            ],
        }  # fmt: skip
        sys.stdout.write(json.dumps(answer) + "\n")
        return
    _show(rows, here, f"seed {seed}, {repeats} repeats, {now}")


def _show(rows: list[Row], here: Machine, subtitle: str) -> None:
    out = Console(highlight=False, width=None if sys.stdout.isatty() else 120)
    grid = Table(title=f"Milliseconds; {subtitle}", title_justify="left")
    grid.add_column("", no_wrap=True)
    for heading in ("points", "CPU p50", "p99", "wall p50", "p99", "goal", ""):
        grid.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        figures = (row.cpu_p50_ms, row.cpu_p99_ms, row.wall_p50_ms, row.wall_p99_ms)
        grid.add_row(row.name, f"{row.points}", *(f"{ms:.2f}" for ms in figures), *_judged(row))
    out.print(grid)
    out.print(
        f"{here.cpu}; {here.usable_cores} of {here.cores} cores; load "
        f"{here.load_1_min:.1f} (1 min), {here.load_5_min:.1f} (5 min) before; "
        f"Python {here.python}. CPU time of the whole process is judged: other work does not "
        "count in it.",
        soft_wrap=True,
    )


def _judged(row: Row) -> tuple[str, str]:
    if row.goal_ms is None:
        return "", ""
    verdict = "[green]met[/]" if row.met else "[red]missed[/]"
    if row.real_time_ms is None or row.times_real is None:
        return f"<= {row.goal_ms:g}", verdict
    return f">= {row.real_time_ms / row.goal_ms:.0f}x", f"{row.times_real:.1f}x {verdict}"
