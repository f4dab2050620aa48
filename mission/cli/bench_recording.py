"""`bladescout bench recording`: what recording a mission and reporting it cost."""

from __future__ import annotations

from typing import Annotated

import typer

from mission.cli.bench_rows import measuring, show_rows
from mission.cli.typed import AsJson


def recording(
    seconds: Annotated[float, typer.Option(min=5, help="To feed the recorder, real time.")] = 30.0,
    photos: Annotated[int, typer.Option(min=12, help="In the report.")] = 300,
    as_json: AsJson = False,
) -> None:
    """Show a recorder's share of a core with every sensor at full rate, and a large report."""
    from benchmarks.latency import machine
    from benchmarks.recording import measure

    here = machine()
    with measuring("recording, then reporting"):
        rows = list(measure(seconds, photos))
    show_rows(
        "recording",
        f"Recording for {seconds:g} s",
        {"seconds": seconds},
        rows,
        here,
        as_json=as_json,
    )
