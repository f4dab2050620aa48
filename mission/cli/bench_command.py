"""`bladescout bench`: the tables of the README, measured here and now."""

from __future__ import annotations

import typer

from mission.cli.bench_angle import angle
from mission.cli.bench_daemon import daemon
from mission.cli.bench_exposure import exposure
from mission.cli.bench_latency import latency
from mission.cli.bench_missions import missions
from mission.cli.bench_recording import recording
from mission.cli.bench_requests import requests
from mission.cli.bench_tracking import tracking
from mission.cli.bench_vehicle import vehicle

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
app.command("tracking")(tracking)
