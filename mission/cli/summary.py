"""The table at the end of a mission."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

#: Name and unit of each column; they fit a terminal of 80 columns.
_COLUMNS = (
    ("blade", ""),
    ("side", ""),
    ("planned", "m"),
    ("coverage", "of skin"),
    ("distance", "m"),
    ("rms", "m"),
    ("clearance", "m"),
    ("photos", "kept"),
)
_COVERAGE = (
    "coverage: of the side's skin, as the kept photos show it; under way: of the metres planned"
)
_STATE_STYLE = {"completed": "bold green", "ended_safely": "bold yellow"}


def _at(record: object, *path: str) -> object:
    for name in path:
        if not isinstance(record, Mapping):
            return None
        record = record.get(name)
    return record


def _number(value: object, form: str, unit: str = "") -> str:
    return f"{value:{form}}{unit}" if isinstance(value, int | float) else "-"


def print_summary(console: Console, mission: Mapping[str, object], folder: Path) -> None:
    """Print state, figures, passes and where the report lies."""
    if mission.get("passes"):
        console.print(_passes(mission))
        console.print(Text(_COVERAGE, style="dim"))
        console.print()
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim")
    table.add_column()
    state = str(_at(mission, "state"))
    table.add_row("state", f"[{_STATE_STYLE.get(state, 'bold red')}]{state}[/]")
    duration = _at(mission, "duration_s")
    minutes = duration / 60 if isinstance(duration, int | float) else None
    words = _at(mission, "words")
    if words and state != "completed":
        table.add_row("", escape(str(words)))
    table.add_row("duration", _number(minutes, ".1f", " simulated minutes"))
    flights = _at(mission, "flights")
    if isinstance(flights, list) and len(flights) > 1:
        table.add_row("flights", f"{len(flights)}, battery swaps {_at(mission, 'swaps')}")
    angle = _number(_at(mission, "rotor", "stop_angle_deg"), ".2f", " deg")
    sigma = _number(_at(mission, "rotor", "sigma_deg"), ".2f")
    table.add_row("stop angle", f"{angle} +- {sigma}")
    if _at(mission, "truth") is not None:
        error = _number(_at(mission, "errors", "stop_angle_deg"), "+.2f", " deg")
        true = _number(_at(mission, "truth", "stop_angle_deg"), ".2f", " deg")
        table.add_row("", f"true {true}, error {error}")
        table.add_row(
            "clearance",
            _number(_at(mission, "truth", "min_clearance_m"), ".1f", " m at least (true)"),
        )
    table.add_row("photos", _number(_at(mission, "photos", "kept"), "d", " kept"))
    gap = _at(mission, "timing", "setpoint_gap_ms", "p99")
    factor = _number(_at(mission, "timing", "real_time_factor"), ".1f")
    table.add_row(
        "timing", f"setpoint gap p99 {_number(gap, '.0f', ' ms')}, real-time factor {factor}"
    )
    console.print(table)
    # Whole, on a line that a terminal makes a link of, however narrow it is.
    console.print(
        Text.assemble(("report      ", "dim"), str(folder / "report.html")), soft_wrap=True
    )


def _passes(mission: Mapping[str, object]) -> Table:
    table = Table(
        title="Passes", title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False
    )
    for name, unit in _COLUMNS:
        table.add_column(f"{name}\n{unit}", justify="right" if unit else "left", no_wrap=True)
    passes = mission.get("passes")
    for one in passes if isinstance(passes, list) else []:
        table.add_row(
            str(_at(one, "blade")),
            str(_at(one, "side")),
            _number(_at(one, "planned_m"), ".1f"),
            _number(_at(one, "coverage"), ".0%"),
            _number(_at(one, "distance_m", "mean"), ".2f"),
            _number(_at(one, "distance_m", "rms_error"), ".2f"),
            _number(_at(one, "clearance_m", "min"), ".1f"),
            _number(_at(one, "photos"), "d"),
        )
    return table
