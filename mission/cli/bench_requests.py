"""`bladescout bench requests`: how soon requests are answered, and what they cost."""

from __future__ import annotations

from typing import Annotated

import typer

from mission.cli.bench_rows import measuring, show_rows
from mission.cli.typed import AsJson


def requests(
    count: Annotated[int, typer.Option(min=20, help="Requests of each kind.")] = 400,
    as_json: AsJson = False,
) -> None:
    """Show how soon requests are answered, what a flood costs, and 200 vehicles at once."""
    from benchmarks.latency import machine
    from benchmarks.requests import measure

    here = machine()
    with measuring("asking"):
        rows = list(measure(count))
    title = f"{count} requests of each kind"
    show_rows("requests", title, {"count": count}, rows, here, as_json=as_json)
