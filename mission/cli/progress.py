"""The live progress of a mission on a terminal, and the closing table."""

from __future__ import annotations

import time
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from mission.flight.command import Progress
from mission.remote.messages import EventMessage, StateMessage

_SEVERITY_STYLE = {
    "info": "dim",
    "none": "dim",
    "warn": "yellow",
    "hold": "bold yellow",
    "stand_off": "bold red",
    "return": "bold red",
    "land": "bold red",
    "release": "bold magenta",
}
_PLAIN_PERIOD_S = 5.0


def _or_dash(value: float | None, form: str, unit: str = "") -> str:
    return "-" if value is None else format(value, form) + unit


def _bar(share: float | None, width: int = 18) -> RenderableType:
    """Return a bar with its figure beside it; a dash where nothing is known."""
    if share is None:
        return Text("-")
    bar = Table.grid(padding=(0, 1))
    completed = min(1.0, max(0.0, share))
    bar.add_row(ProgressBar(total=1.0, completed=completed, width=width), f"{share:.0%}")
    return bar


class LiveProgress:
    """Shows the newest state; on a terminal in place, elsewhere a line every few seconds."""

    def __init__(
        self,
        console: Console,
        title: str,
        *,
        waits_for: str = "waiting for a state",
        silent: bool = False,
    ) -> None:
        self._console = console
        self._title = title
        self._silent = silent
        self._state: StateMessage | None = None
        self._phase = ""
        self._last_line = 0.0
        interactive = console.is_terminal and not silent
        waiting = Text(f"{title}: {waits_for} ...", style="italic")
        self._live = Live(waiting, console=console, refresh_per_second=8) if interactive else None
        if not interactive and not silent:
            console.print(waiting)

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def on_state(self, state: StateMessage) -> None:
        """Show a state."""
        self._state = state
        if self._silent:
            return
        if self._live is not None:
            self._live.update(self._panel(state))
            return
        now = time.monotonic()
        if now - self._last_line > _PLAIN_PERIOD_S or state.progress.phase != self._phase:
            self._last_line, self._phase = now, state.progress.phase
            self._console.print(self._line(state), highlight=False, soft_wrap=True)

    def on_event(self, event: EventMessage) -> None:
        """Print an event above the live panel."""
        if self._silent or event.severity in ("info", "none"):
            return
        word = "cleared" if event.cleared else event.severity
        style = "dim" if event.cleared else _SEVERITY_STYLE.get(event.severity, "")
        self._console.print(
            Text(f"{event.mission_s:7.1f} s  {word:9} {event.text}", style=style), soft_wrap=True
        )

    def _line(self, state: StateMessage) -> str:
        p = state.progress
        parts = [
            f"{state.mission_s:6.0f} s",
            f"{p.phase:9}",
            f"height {_or_dash(_height_m(state), 'z.0f', ' m')}",
            f"clearance {_or_dash(p.clearance_m, '.1f', ' m')}",
            f"battery {_or_dash(state.battery, '.0%')}",
            f"angle {_or_dash(p.stop_angle_deg, '.2f', ' deg')}",
            f"photos {p.photos}",
            f"coverage {p.coverage:.0%}",
            f"x{state.factor:.1f}",
            p.words,
        ]
        return " | ".join(parts)

    def _panel(self, state: StateMessage) -> Panel:
        p = state.progress
        left, right = Table.grid(padding=(0, 1)), Table.grid(padding=(0, 1))
        for grid in (left, right):
            grid.add_column(style="dim", min_width=10)
            grid.add_column(overflow="ellipsis", no_wrap=True)
        left.add_row("phase", Text(p.phase, style="bold cyan"))
        left.add_row("height", _or_dash(_height_m(state), "z.1f", " m"))
        left.add_row("distance", _or_dash(p.distance_m, ".2f", " m"))
        left.add_row("clearance", _or_dash(p.clearance_m, ".1f", " m"))
        left.add_row("stop angle", _angle(p))
        right.add_row("blade", _blade(p))
        right.add_row("photos", str(p.photos))
        right.add_row("coverage", _bar(p.coverage))
        right.add_row("battery", _bar(state.battery))
        grey = _or_dash(state.grey, ".0f")
        right.add_row("exposure", f"grey {grey}  EV {_or_dash(state.ev, '+.2f')}")
        top = Table.grid(expand=True)
        top.add_column(ratio=4)
        top.add_column(ratio=5)
        top.add_row(left, right)
        footer = Text(p.words, style="italic", overflow="ellipsis", no_wrap=True)
        title = f"{self._title}  {state.mission_s:.0f} s  real-time factor {state.factor:.1f}"
        return Panel(Group(top, footer), title=title, border_style="cyan", padding=(0, 1))


def status_table(state: StateMessage) -> Table:
    """Return how the mission stands, a line for each figure."""
    p = state.progress
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    table.add_row("vehicle", state.vehicle if state.link_ok else f"{state.vehicle} (no link)")
    table.add_row("state", Text(p.state, style="bold"))
    table.add_row("phase", Text(p.phase))
    table.add_row("", Text(p.words))
    if state.mission_dir:
        table.add_row("turbine", Text(state.site))
        table.add_row("folder", Text(state.mission_dir))
        table.add_row("stop angle", _angle(p))
        table.add_row("blade", _blade(p))
        table.add_row("photos", f"{p.photos}, coverage {p.coverage:.0%}")
    table.add_row("height", _or_dash(_height_m(state), "z.1f", " m"))
    table.add_row("clearance", _or_dash(p.clearance_m, ".1f", " m"))
    table.add_row("battery", _or_dash(state.battery, ".0%"))
    return table


def _height_m(state: StateMessage) -> float | None:
    if state.height_m is not None or state.position_w is None:
        return state.height_m
    return state.position_w[2]


def _angle(p: Progress) -> str:
    angle = _or_dash(p.stop_angle_deg, ".2f", " deg")
    return angle if p.sigma_deg is None else f"{angle} +- {p.sigma_deg:.2f}"


def _blade(p: Progress) -> str:
    if not p.blade:
        return "-"
    metre = _or_dash(p.metre, ".1f")
    return f"{p.blade} {p.side}  metre {metre}  ({p.pass_index}/{p.pass_count})"
