"""A row of the fault table, and what came of injecting it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Seen:
    """What came of one injected fault."""

    disturbed: int
    """Messages, ticks, bytes or processes that the fault really changed. Never 0 in a proof."""
    events: frozenset[str] = frozenset()
    """Names of everything that was noticed, as the operator's log has them."""
    reacted_s: float | None = None
    """From the injection (what it takes to notice included) to the first safe command."""
    end: str = ""
    closed_m: float = 0.0
    """How much nearer to the turbine the vehicle came after its reaction."""
    allowed_m: float = math.inf
    """How much nearer it may come: 0.5 v + v^2 / 3 (+ 0.1 m of measurement)."""
    clearance_m: float = math.inf
    """Least distance of the airframe's outermost point to the true turbine."""
    figure: str = ""
    """What else was measured, for the reader of SAFETY.md."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: what is done, what must be noticed, how soon, and where it must end."""

    number: int
    """Of the case in the catalogue; a case may have several rows."""
    name: str
    inject: Callable[[], Seen] | str
    """Does the injection and watches; or the test that already shows it, `file::test`."""
    event: str = ""
    """That must be noticed; several names separated by a space: any of them."""
    react_within_s: float | None = None
    end_state: str = ""
    """Allowed ends, separated by a space."""
    slow: bool = False
    """Takes real processes, real time or many draws: `make faults`."""
    lacking: str = field(default="")
    """What of the case the product does not do yet, plainly."""

    @property
    def key(self) -> str:
        """Name of the row in the recorded figures."""
        return f"{self.number:02d} {self.name}"
