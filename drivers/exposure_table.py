"""The exposures that a camera has, and the parameters that make each of them.

Most have an EV, as a list or by steps. Some have none but a shutter and an ISO: there an EV is
a pair of them, as short as the flight wishes and with as little gain as that leaves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

#: What a camera without a list is taken to have: thirds of an EV, and full ones.
USUAL_SHUTTERS_S = tuple(2.0 ** (-k / 3.0) for k in range(39, 17, -1))
USUAL_ISOS = (100.0, 200.0, 400.0, 800.0, 1600.0)
#: Steps that cameras have, the finest first; thirds are often told rounded to a tenth.
USUAL_STEPS_EV = (1 / 3, 1 / 2, 1.0)
#: An EV read back is what was asked for within this.
SAME_EV = 0.02
#: Two pairs nearer than this are one exposure.
_ONE_EXPOSURE_EV = 0.05


@dataclass(frozen=True, slots=True)
class Exposure:
    """One exposure."""

    ev: float
    parameters: tuple[tuple[str, float], ...]
    """Names and values that make it."""


@dataclass(frozen=True, slots=True)
class ExposureTable:
    """All of them, by rising EV."""

    exposures: tuple[Exposure, ...]

    @property
    def min_ev(self) -> float:
        """Lowest EV."""
        return self.exposures[0].ev

    @property
    def max_ev(self) -> float:
        """Highest EV."""
        return self.exposures[-1].ev

    @property
    def step_ev(self) -> float:
        """Usual distance between neighbours."""
        gaps = sorted(b.ev - a.ev for a, b in zip(self.exposures, self.exposures[1:], strict=False))
        return gaps[len(gaps) // 2] if gaps else 1.0

    def nearest(self, ev: float) -> Exposure:
        """Return the exposure nearest to an EV."""
        return min(self.exposures, key=lambda one: abs(one.ev - ev))


def table_of_evs(name: str, evs: Sequence[float]) -> ExposureTable:
    """Return the table of a camera that lists its EVs."""
    return ExposureTable(tuple(Exposure(ev, ((name, ev),)) for ev in sorted(set(evs))))


def table_that_fits(
    name: str, answers: Mapping[float, float], ends: tuple[float, float]
) -> ExposureTable | None:
    """Return the finest usual series that explains what a camera made of wishes, None: none does.

    ``answers``: by wish the EV that it applied, rounded to its nearest; ``ends``: lowest, highest.
    """
    low, high = ends
    for series in _usual_series():
        table = table_of_evs(name, [ev for ev in series if low - SAME_EV <= ev <= high + SAME_EV])
        rounded = (_rounds(series, wish, applied) for wish, applied in answers.items())
        if table.exposures and all(rounded):
            return table
    return None


def _rounds(series: Sequence[float], wish: float, applied: float) -> bool:
    nearest = min(abs(ev - wish) for ev in series)
    known = any(abs(ev - applied) < SAME_EV for ev in series)
    return known and abs(applied - wish) < nearest + SAME_EV


def _usual_series() -> Iterator[tuple[float, ...]]:
    for step in USUAL_STEPS_EV:
        exact = tuple(k * step for k in range(-round(6 / step), round(6 / step) + 1))
        yield exact
        yield tuple(round(ev, 1) for ev in exact)


def table_of_pairs(
    shutter: tuple[str, Sequence[float]],
    iso: tuple[str, Sequence[float]],
    zero: tuple[float, float],
    longest_s: float,
) -> ExposureTable:
    """Return the table of a camera that has a shutter and an ISO but no EV.

    ``shutter``, ``iso``: name and values; ``zero``: shutter (s) and ISO that are EV 0;
    ``longest_s``: a longer shutter only where no ISO makes the exposure with a shorter one.
    """
    none = pair_ev(zero[0], zero[1], (1.0, 1.0))
    pairs = sorted(
        (pair_ev(time, gain, (1.0, 1.0)) - none, max(time / longest_s, 1.0), gain, time)
        for time in shutter[1]
        for gain in iso[1]
        if time > 0 and gain > 0
    )
    chosen: list[tuple[float, float, float, float]] = []
    for pair in pairs:
        if chosen and pair[0] - chosen[-1][0] < _ONE_EXPOSURE_EV:
            # Too long a shutter is worse than gain, gain worse than a longer one still allowed.
            chosen[-1] = min(chosen[-1], pair, key=lambda one: one[1:3])
        else:
            chosen.append(pair)
    return ExposureTable(
        tuple(Exposure(ev, ((shutter[0], time), (iso[0], gain))) for ev, _, gain, time in chosen)
    )


def pair_ev(shutter_s: float, iso: float, zero: tuple[float, float]) -> float:
    """Return the EV of a shutter and an ISO over those of EV 0."""
    return math.log2(shutter_s * iso / (zero[0] * zero[1]))
