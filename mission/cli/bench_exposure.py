"""`bladescout bench exposure`: the paper's table, steps and ramps, and what defects show."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from mission.cli.bench_rows import goals_table
from mission.cli.exits import Exit, end
from mission.cli.typed import AsJson

if TYPE_CHECKING:
    from benchmarks.exposure import Bench
    from benchmarks.exposure_brackets import BracketLine
    from benchmarks.exposure_steps import Outcome


def exposure(
    seed: Annotated[int, typer.Option(help="Draws looks, noise, defects, delays.")] = 1,
    trials: Annotated[int, typer.Option(min=1, help="Times all steps and ramps are run.")] = 1,
    steps_only: Annotated[
        bool, typer.Option("--steps-only", help="Steps and ramps, ours and the paper's alone.")
    ] = False,
    brackets: Annotated[
        Path | None,
        typer.Option(help="A folder of your own bracketed photos instead of drawn looks."),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Where to save the curves from root to tip (PNG).")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare the ways to expose a blade, on the same light."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    if brackets is not None:
        _brackets(brackets, now, as_json=as_json)
        return
    import benchmarks.exposure as bench_module

    bench = bench_module.Bench()
    notes = Console(stderr=True, highlight=False)
    with notes.status("drawing looks") as status:
        for done in bench_module.measure(bench, seed, trials, steps_only=steps_only):
            status.update(f"done: {done}")
    if picture is not None and bench.passes:
        _save_curves(bench, picture)
    if as_json:
        sys.stdout.write(json.dumps(_as_json(bench, seed, trials, now)) + "\n")
    else:
        _show(bench, f"seed {seed}, trials {trials}, {now}")


def _as_json(bench: Bench, seed: int, trials: int, now: str) -> dict[str, object]:
    from benchmarks.exposure import goals

    outcomes = {
        name: [
            {
                "event": one.event.name,
                "change_ev": one.event.change_ev,
                "curve": one.event.kind.curve.value,
                "manual": one.event.kind.manual,
                "latency_s": one.event.kind.latency_s,
                "fps": one.event.fps,
                "outside": one.outside,
                "answered": one.answered,
                "clipped": one.clipped,
                "beyond": one.beyond,
                "restless": one.restless,
            }
            for one in found
        ]
        for name, found in bench.outcomes.items()
    }
    table = [
        {key: None if _unknown(value) else value for key, value in asdict(line).items()}
        for line in bench.lines()
    ]
    return {
        "schema": "bladescout/bench-exposure/1",
        "date": now,
        "seed": seed,
        "trials": trials,
        "settings": {"steps": bench.chosen_for_steps, "passes": bench.chosen_for_passes},
        "goals": [asdict(goal) for goal in goals(bench)],
        "steps": outcomes,
        "table": table,
        "loop_ms": bench.loop_ms,
    }


def _unknown(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)


def _show(bench: Bench, subtitle: str) -> None:
    from benchmarks.exposure import goals

    out = Console(highlight=False, width=None if sys.stdout.isatty() else 200)
    out.print(f"Exposure; {subtitle}", soft_wrap=True)
    for manual, words in ((True, "manual exposure"), (False, "compensation of an automatic")):
        out.print(_steps(bench, words, manual=manual))
    if bench.passes:
        out.print(_table(bench))
    told = ((goal.name, goal.value, goal.goal, goal.met) for goal in goals(bench))
    out.print(goals_table("goals", told))


def _steps(bench: Bench, words: str, *, manual: bool) -> Table:
    """Frames outside, median / worst over latencies, rates and directions."""
    grid = Table(
        title=f"frames outside after a change of the light, median / worst; {words}",
        title_justify="left",
    )
    names = ("step 2 EV", "step 3 EV", "step 4 EV", "ramp 3 EV")
    latencies = (0.05, 0.1, 0.2, 0.4)
    for heading in ("", "settings", *names, *(f"steps, {s * 1e3:.0f} ms" for s in latencies)):
        grid.add_column(heading, justify="left" if heading in ("", "settings") else "right")
    for method, found in bench.outcomes.items():
        own = [one for one in found if one.event.kind.manual is manual]
        cells = [_spread([one for one in own if one.event.name == name]) for name in names]
        cells += [
            _spread([one for one in own if one.event.frames == 1 and one.event.kind.latency_s == s])
            for s in latencies
        ]
        grid.add_row(method, bench.chosen_for_steps[method], *cells)
    return grid


def _spread(outcomes: list[Outcome]) -> str:
    frames = [one.outside for one in outcomes]
    return f"{median(frames):g} / {max(frames)}" if frames else "-"


def _table(bench: Bench) -> Table:
    from benchmarks.exposure_passes import FRAMES

    grid = Table(
        title=f"stills of the blade, root to tip (grey, nats); live frames outside of {FRAMES}",
        title_justify="left",
    )
    headings = ("case", "method", "mean", "sigma", "entropy", "in range", "outside", "CNR", "CLAHE")
    for heading in headings:
        grid.add_column(heading, justify="left" if heading in ("case", "method") else "right")
    for line in sorted(bench.lines(), key=lambda line: line.case):
        grid.add_row(
            line.case,
            line.method,
            _cell(line.mean, 1),
            _cell(line.sigma, 2),
            _cell(line.entropy_nats, 2),
            _cell(100 * line.in_range, 0, " %"),
            str(line.outside),
            _cell(line.cnr, 2),
            _cell(line.cnr_clahe, 2),
        )
    return grid


def _cell(value: float, digits: int, unit: str = "") -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}{unit}"


def _save_curves(bench: Bench, picture: Path) -> None:
    import cv2

    from benchmarks.exposure_figure import curves
    from benchmarks.exposure_methods import AUTOMATIC, OURS, PAPER
    from benchmarks.exposure_scene import Lighting

    shown = [one for one in bench.passes if one.lighting is Lighting.CLOUDS]
    drawn = curves(shown, (AUTOMATIC, PAPER, OURS), "Root to tip under passing clouds")
    try:
        written = cv2.imwrite(str(picture), drawn)
    except cv2.error:  # it knows no such ending
        written = False
    if not written:
        end(Exit.CONFIGURATION, f"--picture {picture}: cannot be written; name a PNG file")


def _brackets(folder: Path, now: str, *, as_json: bool) -> None:
    from benchmarks.exposure_brackets import NoBrackets, measure
    from benchmarks.exposure_brackets import brackets as read

    try:
        found = list(measure(read(folder)))
    except NoBrackets as error:
        end(Exit.CONFIGURATION, str(error))
    if as_json:
        rows = [asdict(line) for line in found]
        answer = {"schema": "bladescout/bench-exposure-brackets/1", "date": now, "rows": rows}
        sys.stdout.write(json.dumps(answer) + "\n")
        return
    out = Console(highlight=False, width=None if sys.stdout.isatty() else 200)
    out.print(_bracket_table(found, f"{folder}, {now}"))


def _bracket_table(found: list[BracketLine], subtitle: str) -> Table:
    grid = Table(title=f"bracketed photos; {subtitle}", title_justify="left")
    for heading in ("scene", "method", "from", "EV", "frames", "mean", "sigma", "entropy", "in"):
        grid.add_column(heading)
    for line in found:
        grid.add_row(
            line.scene,
            line.method,
            line.start,
            f"{line.ev:+.2f}",
            str(line.frames),
            f"{line.mean:.1f}",
            f"{line.sigma:.2f}",
            f"{line.entropy_nats:.2f}",
            "yes" if line.in_range else "no",
        )
    return grid
