"""How `bladescout estimate` shows its answer on a terminal."""

from __future__ import annotations

from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from perception.cloud_estimate import CloudAnswer, Question
from perception.rotor import Refusal, RefusalCode, Rotor, blade_angles_deg
from perception.values import Float

_FOUND_BY = {
    "given": "the prior hub that was given",
    "tower": "the tower in the cloud",
    "rotor": "the three blades alone",
}
_REFUSED = {
    RefusalCode.NO_POINTS: "too little of a rotor is in the cloud",
    RefusalCode.NO_PLANE: "nothing in the cloud stands in a plane as blades do",
    RefusalCode.NO_RING: "no ring round the hub meets three blades",
    RefusalCode.TWO_BLADES: "two blades are seen, and three are needed",
    RefusalCode.LOW_VISIBILITY: "too little of a blade is seen",
    RefusalCode.SIDE_UNKNOWN: "it is not known whether the rotor is seen from the front",
    RefusalCode.ROTOR_TURNING: "the rotor turns",
    RefusalCode.NOT_A_ROTOR: "what is seen is no rotor of three blades",
    RefusalCode.NOT_CONVERGED: "looks at the rotor do not agree",
}
_METHOD = {"rotor_fit": "rotor_fit, one joint fit of the rotor", "fermat": "fermat, the paper's"}
_REFERENCE = {"tower": "the tower's axis", "gravity": "gravity (z down)"}


def blade_table(rotor: Rotor) -> Table:
    """Return name, angle, direction and pitch of each blade."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("blade\n", "angle\ndeg", "direction\neast, north, up", "pitch\ndeg", "+-\n"):
        table.add_column(heading, justify="left" if heading.startswith("blade") else "right")
    for blade, angle in zip(rotor.blades, blade_angles_deg(rotor.stop_angle_deg), strict=True):
        table.add_row(
            blade.name,
            f"{angle:.2f}",
            _numbers(blade.direction_w, ".3f"),
            "unknown" if blade.pitch_deg is None else f"{blade.pitch_deg:.1f}",
            "-" if blade.pitch_sigma_deg is None else f"{blade.pitch_sigma_deg:.1f}",
        )
    return table


def answer_table(path: Path, answer: CloudAnswer, question: Question) -> Table:
    """Return the figures of the rotor, or the refusal in words."""
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    rotor = answer.rotor
    if isinstance(rotor, Refusal):
        table.add_row("refused", f"[bold red]{_REFUSED[rotor.code]}[/] ({rotor.code})")
        table.add_row("", escape(rotor.text))
    else:
        angle = f"[bold green]{rotor.stop_angle_deg:.2f} deg[/] +- {rotor.sigma_deg:.2f}"
        table.add_row("stop angle", angle)
        table.add_row("", f"from straight down by {_REFERENCE[rotor.reference]}")
        if answer.from_behind:
            table.add_row("", "[yellow]seen from behind: coarser than from the front[/]")
        table.add_row("hub", f"{_numbers(rotor.hub_w, '.2f')} m (east, north, up)")
        table.add_row("normal", f"{_numbers(rotor.normal_w, '.4f')} (rotor to nacelle)")
        table.add_row("method", _METHOD[rotor.method])
    table.add_row("found by", _FOUND_BY[answer.found_by])
    turbine = question.turbine
    table.add_row("turbine", "not given" if turbine is None else escape(turbine.name))
    if answer.looks > 1 and answer.spread_deg is not None:
        table.add_row("looks", f"{answer.looks}, {answer.spread_deg:.2f} deg apart")
    left_out = f", {answer.dropped} not finite or empty" if answer.dropped else ""
    table.add_row("points", f"{answer.points} round the rotor{left_out}")
    table.add_row("cloud", escape(str(path)))
    return table


def _numbers(values: Float, form: str) -> str:
    return ", ".join(format(float(value), form) for value in values)
