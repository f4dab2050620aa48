"""`bladescout bench daemon`: what the daemon costs, idle and in flight."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from mission.cli.bench_rows import measuring
from mission.cli.typed import AsJson

if TYPE_CHECKING:
    from benchmarks.daemon import Measured


def daemon(
    seconds: Annotated[float, typer.Option(min=3, help="Of each stage, mission time.")] = 20.0,
    speed: Annotated[float, typer.Option(min=0.05, max=1, help="Below 1 on a busy machine.")] = 1.0,
    seed: Annotated[int, typer.Option(help="Draws turbine, weather and launch.")] = 1,
    fly: Annotated[bool, typer.Option(help="Start a mission too (minutes).")] = True,
    track: Annotated[bool, typer.Option(help="Fly on as far as along a blade.")] = True,
    light: Annotated[
        bool,
        typer.Option(help="Along a blade alone, time exposure commands as the light changes."),
    ] = False,
    threads: Annotated[bool, typer.Option(help="Show the threads that cost most.")] = False,
    as_json: AsJson = False,
) -> None:
    """Measure the daemon's own processes with every sensor at full rate."""
    from benchmarks.daemon import measure
    from benchmarks.daemon_light import GOAL_MS
    from benchmarks.latency import machine

    here = machine()
    with measuring("measuring") as tell:
        found = measure(seed, seconds, speed, fly=fly, track=track, light=light, tell=tell)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    if as_json:
        answer = {
            "schema": "bladescout/bench-daemon/1",
            "date": now,
            "seed": seed,
            "speed": speed,
            "machine": asdict(here),
            "ready_s": found.ready_s,
            "ready_cpu_s": found.ready_cpu_s,
            "stages": [
                {
                    "name": stage.name,
                    "seconds": stage.shares.span_s,
                    "percent_of_a_core": stage.shares.by_process(),
                    "memory_mb": stage.memory_mb,
                    "scans_hz": stage.scans_hz,
                    "frames_hz": stage.frames_hz,
                }
                for stage in found.stages
            ],
            "flood": None if found.flood is None else asdict(found.flood),
            "light": None if found.light is None else asdict(found.light),
        }
        sys.stdout.write(json.dumps(answer) + "\n")
        return
    out = Console(highlight=False, width=None if sys.stdout.isatty() else 100)
    if found.stages:
        out.print(_table(found, f"The daemon, {seconds:g} s a stage, seed {seed}, {now}"))
    out.print(
        f"ready after {found.ready_s:.1f} s (goal 5 s), {found.ready_cpu_s:.1f} s of CPU time; "
        f"{here.cpu}; load {here.load_1_min:.1f} (1 min) before",
        soft_wrap=True,
    )
    if found.flood is not None:
        quiet, flooded = found.flood.quiet, found.flood.flooded
        out.print(
            f"setpoint gap p50 / p99 / max: "
            f"{quiet.p50:.0f} / {quiet.p99:.0f} / {quiet.most:.0f} ms; "
            f"in a flood of {found.flood.asked_per_s:.0f} requests a second: "
            f"{flooded.p50:.0f} / {flooded.p99:.0f} / {flooded.most:.0f} ms",
            soft_wrap=True,
        )
    if light and found.light is None:
        words = "the flight turned back before a blade: at speed 1 it wants the machine to itself"
        heard = "no exposure command was heard along a blade"
        out.print(heard if found.stages else words, soft_wrap=True)
    if found.light is not None:
        lag = found.light
        out.print(
            f"decoded picture to exposure command on the wire, {lag.commands} commands, "
            f"p50 / p99 / max: {lag.p50:.0f} / {lag.p99:.0f} / {lag.most:.0f} ms (goal p99 "
            f"{GOAL_MS:g} ms)",
            soft_wrap=True,
        )
    if threads:
        for stage in found.stages:
            for process, thread, share in stage.shares.by_thread(0.2):
                out.print(f"{stage.name:15} {process:12} {thread:16} {share:6.2f} %")


def _table(found: Measured, title: str) -> Table:
    grid = Table(title=title, title_justify="left")
    grid.add_column("")
    for stage in found.stages:
        grid.add_column(f"{stage.name}: % of a core", justify="right")
        grid.add_column("MB", justify="right")
    shares = [stage.shares.by_process() for stage in found.stages]
    for name in sorted(shares[-1], key=lambda key: -shares[-1][key]):
        cells = []
        for stage, share in zip(found.stages, shares, strict=True):
            cells += [f"{share.get(name, 0.0):.1f}", f"{stage.memory_mb.get(name, 0.0):.0f}"]
        grid.add_row(name, *cells)
    sums, goals = [], []
    for stage in found.stages:
        sums += [f"{stage.shares.total:.1f}", f"{sum(stage.memory_mb.values()):.0f}"]
        goals += [
            "" if goal is None else f"{goal:g}" for goal in (stage.goal_percent, stage.goal_mb)
        ]
    grid.add_row("together", *sums, style="bold")
    grid.add_row("goal", *goals)
    looked = [(f"{stage.scans_hz:.1f}", f"{stage.frames_hz:.1f}") for stage in found.stages]
    grid.add_row("scans, pictures looked at, Hz", *(cell for pair in looked for cell in pair))
    return grid
