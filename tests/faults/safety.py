"""Renders SAFETY.md from the fault table and the figures last measured.

``python -m tests.faults.safety`` writes the file; ``make safety`` measures first.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from tests.faults.fault import Fault
from tests.faults.table import CASES, FAULTS

ROOT = Path(__file__).parents[2]
FIGURES = Path(__file__).parent / "measured.json"
MUTANTS = Path(__file__).parent / "mutants.json"
OUT = ROOT / "SAFETY.md"

_HEAD = """# Safety

What must not break the flight, what is done about it, and what was measured. This page is
rendered from the table that drives the tests (`tests/faults/`): `make safety` measures the quick
rows anew and writes it, `make faults` measures the long ones as well. Times are mission seconds,
seeds are fixed in the table, dates are those of the last run.

**P1** The pilot can always take over: a mode change is never fought. **P2** Whatever fails, within
0.5 s of its being detectable nothing further is commanded toward the turbine; until it stands the
vehicle closes by at most 0.5 v + v²/3. Every setpoint is such that the vehicle, obeying it for
ever, stays 8 m clear of everything.

What is between a fault and the turbine, outermost first: the autopilot's own failsafes (silence is
one of them), the dead-man (`mission/processes/dead_man.py`), the guard that re-checks every
setpoint (`mission/flight/guard.py`), the table of events and reactions
(`mission/flight/events.py`). A bladescout that is dead, blocked or killed sends nothing, and an
autopilot that hears nothing for COM_OF_LOSS_T holds.

## Every case

*Noticed* is the name in the event log; *within* is the limit on the time from the injection to the
first safe command, with what was measured behind it. A row that names a test is shown by that
test.
"""


def rendered(figures: Mapping[str, Mapping[str, object]]) -> str:
    """Return the page."""
    parts = [_HEAD]
    for number, title in CASES.items():
        rows = [fault for fault in FAULTS if fault.number == number]
        parts.append(_case(number, title, rows, figures))
    parts.append(_not_yet())
    parts.append(_guard())
    return "\n".join(parts)


def _case(
    number: int, title: str, rows: list[Fault], figures: Mapping[str, Mapping[str, object]]
) -> str:
    lines = [f"### {number}. {title}\n", "| fault | noticed | within | ends | measured |",
             "|---|---|---|---|---|"]  # fmt: skip
    for fault in rows:
        if isinstance(fault.inject, str):
            file, _, name = fault.inject.partition("::")
            lines.append(f"| {fault.name} | | | | `{file}`: {name.removeprefix('test_')} |")
            continue
        figure = figures.get(fault.key)
        lines.append(
            f"| {fault.name} | {fault.event.replace(' ', ', ')} | {_within(fault, figure)} "
            f"| {fault.end_state.replace(' ', ' or ').replace('_', ' ')} "
            f"| {_measured(fault, figure)} |"
        )
    return "\n".join([*lines, ""])


def _within(fault: Fault, figure: Mapping[str, object] | None) -> str:
    if fault.react_within_s is None:
        return ""
    took = None if figure is None else figure.get("reacted_s")
    return f"{fault.react_within_s:g} s" + ("" if took is None else f" ({took} s)")


def _measured(fault: Fault, figure: Mapping[str, object] | None) -> str:
    if figure is None:
        return "not measured yet" + (" (`make faults`)" if fault.slow else "")
    words = [str(figure["figure"])] if figure["figure"] else []
    if figure["clearance_m"] is not None:
        words.append(f"clearance never below {figure['clearance_m']:.1f} m")
    if figure["closed_m"] and figure["allowed_m"] is not None:
        words.append(f"closed by {figure['closed_m']} m of {figure['allowed_m']} allowed")
    words.append(str(figure["date"]))
    return "; ".join(words).replace("|", "/")


def _not_yet() -> str:
    lacking = [fault for fault in FAULTS if fault.lacking]
    lines = ["## Not yet\n", "What the catalogue asks for and the product does not do.\n"]
    told: dict[str, str] = {}
    for fault in lacking:
        told.setdefault(fault.lacking, f"- **{fault.number}. {CASES[fault.number]}**: ")
    return "\n".join([*lines, *(head + text + "." for text, head in told.items()), ""])


def _guard() -> str:
    lines = ["## The guard\n"]
    if not MUTANTS.exists():
        return "\n".join([*lines, "Not mutation-tested yet (`make mutants`).", ""])
    kept = json.loads(MUTANTS.read_text())
    drawn = (
        "all that there are"
        if kept["tried"] == kept["mutants"]
        else f"drawn at random from all {kept['mutants']}"
    )
    lines.append(
        f"{kept['killed']} of {kept['tried']} mutants of `mission/flight/guard.py` are found by "
        f"its tests ({drawn}); branches covered: "
        f"{kept['branches']} ({kept['date']}, `make mutants`). Those that survive, and why that is "
        "no gap:\n"
    )
    lines += [f"- `{mutant['change']}`: {mutant['why']}" for mutant in kept["survivors"]]
    return "\n".join([*lines, ""])


def main() -> None:
    """Write SAFETY.md."""
    figures = json.loads(FIGURES.read_text()) if FIGURES.exists() else {}
    OUT.write_text(rendered(figures))


if __name__ == "__main__":
    main()
