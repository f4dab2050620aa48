"""`bladescout bench missions`: whole simulated missions of many seeds, in one table."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from mission.cli.simulate_command import load_scenario, make_room
from mission.cli.typed import AsJson

if TYPE_CHECKING:
    from benchmarks.missions import Flown

#: Heading, field, format.
_COLUMNS = (
    ("seed", "seed", "d"),
    ("state", "state", "s"),
    ("angle", "stop_angle_deg", ".2f"),
    ("error", "error_deg", "+.2f"),
    ("sigma", "sigma_deg", ".2f"),
    ("measured in s", "estimate_s", ".0f"),
    ("clearance", "clearance_m", ".1f"),
    ("coverage", "coverage", ".0%"),
    ("photos", "kept", "d"),
    ("simulated s", "simulated_s", ".0f"),
    ("gap p99 ms", "gap_p99_ms", ".0f"),
    ("factor", "factor", ".1f"),
)
_GOALS = (
    ("missions", "missions", ".0f", ""),
    ("completed", "completed", ".0f", "all"),
    ("|error| median, deg", "error_median_deg", ".2f", "0.2"),
    ("|error| p95, deg", "error_p95_deg", ".2f", "0.6"),
    ("|error| max, deg", "error_max_deg", ".2f", "2"),
    ("measured within, s (max)", "estimate_max_s", ".0f", "15"),
    ("least true clearance, m", "clearance_min_m", ".1f", "8"),
    ("longest, simulated s", "simulated_max_s", ".0f", "480 (demo)"),
    ("setpoint gap p99, ms (max)", "gap_p99_max_ms", ".0f", ""),
)


def missions(
    count: Annotated[int, typer.Option("--missions", min=1, help="How many are flown.")] = 13,
    seed: Annotated[
        int | None, typer.Option(help="First seed; without it seeds are drawn and printed.")
    ] = None,
    scenario: Annotated[str, typer.Option(help="A packaged scenario or a TOML file.")] = "demo",
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="section.key=value, for every mission.")
    ] = None,
    edges: Annotated[
        bool, typer.Option(help="Begin with stop angles of 0, 60 and 119.95 degrees.")
    ] = True,
    out: Annotated[
        Path, typer.Option(help="Folder of the missions; one that was begun is gone on with.")
    ] = Path("missions/bench"),
    as_json: AsJson = False,
) -> None:
    """Fly whole missions of many seeds and show how each ended. Takes minutes a mission."""
    from benchmarks.missions import figures, fly, seeds_of

    load_scenario(scenario, set_ or [], {})
    make_room(out, None)
    notes = Console(stderr=True, highlight=False)
    seeds = seeds_of(count, seed)
    notes.print(f"seeds: {' '.join(map(str, seeds))}", soft_wrap=True)
    flown: list[Flown] = []
    for one in fly(seeds, scenario, set_ or [], out, edges=edges):
        flown.append(one)
        notes.print(
            f"{len(flown)} of {count}: seed {one.seed} {one.state}, {one.words}", soft_wrap=True
        )
    now = datetime.now(UTC).isoformat(timespec="seconds")
    answer = figures(flown)
    if as_json:
        rows = [asdict(one) for one in flown]
        whole = {
            "schema": "bladescout/bench-missions/1", "date": now, "scenario": scenario,
            "set": set_ or [], "figures": answer, "missions": rows,
        }  # fmt: skip
        sys.stdout.write(json.dumps(whole) + "\n")
    else:
        _show(flown, answer, f"{scenario}, {now}")
    if any(one.exit_code != 0 for one in flown):
        raise typer.Exit(4)


def _show(flown: list[Flown], answer: dict[str, float | None], title: str) -> None:
    out = Console(highlight=False, width=None if sys.stdout.isatty() else 140)
    grid = Table(title=f"Missions flown: {title}", title_justify="left")
    for heading, _, _ in _COLUMNS:
        grid.add_column(heading, justify="left" if heading == "state" else "right")
    for one in flown:
        grid.add_row(*(_cell(getattr(one, key), form) for _, key, form in _COLUMNS))
    out.print(grid)
    grid = Table()
    for heading in ("", "measured", "goal"):
        grid.add_column(heading, justify="left" if not heading else "right")
    for name, key, form, goal in _GOALS:
        grid.add_row(name, _cell(answer[key], form), goal)
    out.print(grid)


def _cell(value: float | str | None, form: str) -> str:
    return "-" if value is None else format(value, form)
