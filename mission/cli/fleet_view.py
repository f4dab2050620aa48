"""`bladescout watch --all`: a line for every vehicle, renewed in place."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, Group, RenderResult
from rich.live import Live
from rich.table import Table
from rich.text import Text

from mission.cli.remote_commands import reached

if TYPE_CHECKING:
    from mission.remote.fleet import Fleet, Sighting

_PERIOD_S = 0.5
_PLAIN_PERIOD_S = 5.0
#: Title, least width, and whether it holds words.
_COLUMNS = (
    ("vehicle", 7, True),
    ("turbine", 7, True),
    ("state", 7, True),
    ("phase", 8, True),
    ("doing", 16, True),
    ("angle", 8, False),
    ("clearance", 9, False),
    ("battery", 7, False),
    ("covered", 7, False),
    ("age", 6, False),
)
#: Terminals from here on show every column; others do without these.
_WIDE = 120
_SPARED = ("doing", "angle")
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
            console.print(FleetTable(fleet.vehicles()))
    with Live(console=console, refresh_per_second=4) as live:
        while True:
            live.update(Group(FleetTable(fleet.vehicles()), Text("Ctrl-C ends", style="dim")))
            time.sleep(_PERIOD_S)


class FleetTable:
    """A row for each vehicle: what it does, how near, how full, how old that is.

    Where the terminal is narrow, what can be spared is left out rather than all of it cut short.
    """

    def __init__(self, vehicles: dict[str, Sighting]) -> None:
        self._vehicles = vehicles

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the table that fits."""
        if not self._vehicles:
            yield Text("no vehicle was heard yet ...", style="italic")
            return
        wide = options.max_width >= _WIDE
        table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), expand=wide)
        for title, least, words in _COLUMNS:
            if wide or title not in _SPARED:
                table.add_column(
                    title,
                    justify="left" if words else "right",
                    no_wrap=True,
                    overflow="ellipsis",
                    min_width=least,
                )
        for name, seen in self._vehicles.items():
            cells, lost = _cells(name, seen)
            shown = [cells[title] for title, *_ in _COLUMNS if wide or title not in _SPARED]
            table.add_row(*shown, style="dim" if lost else "")
        yield table


def _cells(name: str, seen: Sighting) -> tuple[dict[str, Text | str], bool]:
    """Return a vehicle's cells by their titles, and whether it is not heard any more."""
    from mission.remote.fleet import LOST_S

    state, p, age_s = seen.state, seen.state.progress, seen.age_s()
    lost = age_s > LOST_S
    return {
        "vehicle": Text(name, style="bold"),
        "turbine": state.site or "-",
        "state": Text(p.state, style=_STATE_STYLE.get(p.state, "")),
        "phase": p.phase,
        "doing": f"{p.blade} {p.side}  {p.words}".strip(),
        "angle": "-" if p.stop_angle_deg is None else f"{p.stop_angle_deg:.1f} deg",
        "clearance": "-" if p.clearance_m is None else f"{p.clearance_m:.1f} m",
        "battery": "-" if state.battery is None else f"{state.battery:.0%}",
        "covered": f"{p.coverage:.0%}",
        "age": Text(f"{age_s:.1f} s", style="bold red" if lost else ""),
    }, lost
