"""What the machine itself can say of a mission: the flight's part of mission.json."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from mission.flight.command import MissionState, Phase
from mission.flight.events import EventRecord
from mission.flight.leg import Unseen
from mission.flight.observation import RotorEstimate


@dataclass(frozen=True, slots=True)
class PhaseTime:
    """When a phase was entered and left, mission seconds."""

    phase: Phase
    from_s: float
    to_s: float


@dataclass(frozen=True, slots=True)
class PassReport:
    """One side of one blade as flown."""

    blade: str
    side: str
    length_m: float
    planned_m: float
    photographed_m: float
    """Metres of the blade within the footprint of a kept photo, by the fitted geometry."""
    distance_mean_m: float | None
    distance_rms_error_m: float | None
    distance_min_m: float | None
    clearance_min_m: float | None
    photos: int
    rejected: int
    unseen: tuple[Unseen, ...]
    skipped: bool = False
    stretches: tuple[tuple[float, float], ...] = ()
    """Where those metres lie: (from, to), rising and apart; together `photographed_m`."""
    coverage: float | None = None
    """Share of the side's skin that the kept photos show (design, Definitions), by the fitted
    geometry and the camera's reported poses; None where the blade's pitch is not known."""


@dataclass(frozen=True, slots=True)
class MissionReport:
    """The mission so far."""

    state: MissionState
    words: str
    started_s: float | None
    duration_s: float
    phases: tuple[PhaseTime, ...]
    rotor: RotorEstimate | None
    iterations: int
    """Rotor estimates until convergence, refusals included."""
    passes: tuple[PassReport, ...]
    events: tuple[EventRecord, ...]
    swap: bool = False
    """The energy ended this flight: with a fresh battery another one can go on."""


@dataclass(slots=True)
class Spread:
    """Running mean, least, and root mean square of the error against a wanted value."""

    count: int = 0
    total: float = 0.0
    squared_error: float = 0.0
    least: float = field(default=math.inf)

    def add(self, value: float, wanted: float) -> None:
        """Take one more value."""
        self.count += 1
        self.total += value
        self.squared_error += (value - wanted) ** 2
        self.least = min(self.least, value)

    @property
    def mean(self) -> float | None:
        """Mean of the values."""
        return self.total / self.count if self.count else None

    @property
    def rms_error(self) -> float | None:
        """Root mean square of the differences from what was wanted."""
        return math.sqrt(self.squared_error / self.count) if self.count else None


def covered_stretches(
    stretches: Iterable[tuple[float, float]], length_m: float, unseen: Sequence[Unseen] = ()
) -> tuple[tuple[float, float], ...]:
    """Return the union of stretches (from, to) within the blade, less what is unseen, rising."""
    union: list[tuple[float, float]] = []
    for begin, end in sorted(stretches):
        low, high = max(begin, 0.0), min(end, length_m)
        if union and low <= union[-1][1]:
            union[-1] = (union[-1][0], max(union[-1][1], high))
        elif high > low:
            union.append((low, high))
    for gap in unseen:
        parts = [
            part
            for low, high in union
            for part in ((low, min(high, gap.from_m)), (max(low, gap.to_m), high))
        ]
        union = [(low, high) for low, high in parts if high > low]
    return tuple(union)
