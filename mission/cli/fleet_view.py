"""`bladescout watch --all`: a line for every vehicle, renewed in place."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from mission.cli.remote_commands import reached

if TYPE_CHECKING:
    from mission.remote.fleet import Fleet, Sighting

_PERIOD_S = 0.5
_PLAIN_PERIOD_S = 5.0
_STATE_STYLE = {
    "running": "green",
    "paused": "yellow",
    "completed": "bold green",
    "idle": "dim",
    "ended_safely": "yellow",
    "refused": "red",
    "failed": "bold red",
    "released": "magenta",
}


def watch_all(router: str, keys: str) -> None:
    """Show every vehicle of a router until interrupted."""
    from mission.remote.client import bus_settings
    from mission.remote.fleet import Fleet

    with reached(router, lambda: Fleet(bus_settings(router, keys))) as fleet:
        try:
            _show(fleet, Console())
        except KeyboardInterrupt:
            return


def _show(fleet: Fleet, console: Console) -> None:
    if not console.is_terminal:
        while True:
            time.sleep(_PLAIN_PERIOD_S)
            console.print(fleet_table(fleet.vehicles()))
    with Live(console=console, refresh_per_second=4) as live:
        while True:
            live.update(Group(fleet_table(fleet.vehicles()), Text("Ctrl-C ends", style="dim")))
            time.sleep(_PERIOD_S)


def fleet_table(vehicles: dict[str, Sighting]) -> RenderableType:
    """Return a row for each vehicle: what it does, how near, how full, how old that is."""
    from mission.remote.fleet import LOST_S

    if not vehicles:
        return Text("no vehicle was heard yet ...", style="italic")
    table = Table(expand=True)
    for title in ("vehicle", "turbine", "state", "phase", "doing"):
        table.add_column(title, no_wrap=True, overflow="ellipsis")
    for title in ("angle", "clearance", "battery", "covered", "age"):
        table.add_column(title, justify="right", no_wrap=True)
    for name, seen in vehicles.items():
        state, p, age_s = seen.state, seen.state.progress, seen.age_s()
        lost = age_s > LOST_S
        table.add_row(
            Text(name, style="bold"),
            state.site or "-",
            Text(p.state, style=_STATE_STYLE.get(p.state, "")),
            p.phase,
            f"{p.blade} {p.side}  {p.words}".strip(),
            "-" if p.stop_angle_deg is None else f"{p.stop_angle_deg:.1f} deg",
            "-" if p.clearance_m is None else f"{p.clearance_m:.1f} m",
            "-" if state.battery is None else f"{state.battery:.0%}",
            f"{p.coverage:.0%}",
            Text(f"{age_s:.1f} s", style="bold red" if lost else ""),
            style="dim" if lost else "",
        )
    return table
