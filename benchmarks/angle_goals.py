"""What the angle bench has to show, each goal beside what was measured."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from benchmarks import angle
from benchmarks.angle import Table, fog_row, stratum_row
from benchmarks.angle_summary import STRATA_DEG, Row, in_strata, row
from benchmarks.blade_family import DRAWN, HELD_OUT

#: Scenes of a stratum that are worth a figure.
LEAST_TRIALS = 20
#: Key of the share of errors that a sigma should hardly ever miss by.
FAR_OFF = "beyond_4_sigma"


class Goal(NamedTuple):
    """One goal; ``measured`` is None where the run does not tell."""

    what: str
    least: float
    most: float
    measured: float | None

    @property
    def met(self) -> bool | None:
        """Whether it was reached."""
        if self.measured is None:
            return None
        return self.least <= self.measured <= self.most


def goals(table: Table) -> list[Goal]:
    """Return every goal with the figure of a run."""
    rows = table.rows()
    return [
        *_of_ours(rows.get(angle.OURS, {})),
        *_of_sigma(table),
        *_of_strata(table),
        *_of_known(rows),
        *_of_weather(rows),
        *_of_paper(rows),
    ]


def _of_ours(row: Row) -> list[Goal]:
    share = {"refused": _share(row, "refused")}
    limits = (
        ("mean", "mean_deg", 0, 0.2),
        ("p95", "p95_deg", 0, 0.5),
        ("p99.9", "p999_deg", 0, 1.5),
        ("hub across p95, m", "across_p95_m", 0, 0.15),
        ("hub along p95, m", "along_p95_m", 0, 0.4),
        ("normal p95", "normal_p95_deg", 0, 0.5),
        ("pitch p95", "pitch_p95_deg", 0, 4),
        ("pitch not told", "pitch_unknown", 0, 0.02),
        ("LE and TE swapped", "pitch_swapped", 0, 0),
        ("within 1 deg", "success_1", 0.995, 1),
        ("refused", "refused", 0, 0.005),
        ("median sigma", "sigma_median_deg", 0, 0.25),
        ("ms a fit", "ms_median", 0, 20),
    )
    told = row | share
    return [Goal(f"ours: {name}", low, high, told.get(key)) for name, key, low, high in limits]


def _of_sigma(table: Table) -> list[Goal]:
    """Of all turbines, and of those that the sigma was not calibrated on."""
    trials = table.trials.get(angle.OURS, [])
    strangers = [trial for trial in trials if trial.model in HELD_OUT and trial.model != DRAWN]
    limits = (
        ("within 1 sigma", "within_1_sigma", 0.60, 0.76),
        ("within 2 sigma", "within_2_sigma", 0.92, 0.98),
        ("beyond 4 sigma", FAR_OFF, 0, 0.001),
    )
    told = [("ours", row(trials)), ("ours, turbines not calibrated on", row(strangers))]
    return [
        Goal(f"{whose}: {name}", low, high, figures.get(key))
        for whose, figures in told
        for name, key, low, high in limits
    ]


def _of_strata(table: Table) -> list[Goal]:
    """Of every 15 deg of pitch, by the nominal scenes and those drawn for the stratum.

    Too few scenes say nothing of a stratum's worst.
    """
    nominal = in_strata(table.trials.get(angle.OURS, []))
    gathered = [nominal.get(low, []) + table.trials.get(stratum_row(low), []) for low in STRATA_DEG]
    parts = [row(trials) for trials in gathered if len(trials) >= LEAST_TRIALS]
    limits = (("mean_deg", 0.4), ("p95_deg", 1.0), ("bias_deg", 0.2))
    return (
        [
            Goal(f"worst stratum of pitch: {key[:-4]}", 0, most, _worst(parts, key))
            for key, most in limits
        ]
        + [
            Goal(f"{which} stratum of pitch: within {n} sigma", low, high, _of(parts, pick, n))
            for n, low, high in ((1, 0.60, 0.76), (2, 0.92, 0.98))
            for which, pick in (("least", min), ("greatest", max))
        ]
        + [
            Goal(
                "greatest stratum of pitch: beyond 4 sigma", 0, 0.001, _of(parts, max, key=FAR_OFF)
            ),
        ]
    )


def _of(
    parts: list[Row], pick: Callable[[list[float]], float], sigmas: int = 0, key: str = ""
) -> float | None:
    values = [part[key or f"within_{sigmas}_sigma"] for part in parts]
    told = [value for value in values if value is not None]
    return pick(told) if told else None


def _of_known(rows: dict[str, Row]) -> list[Goal]:
    return [
        Goal("known shape: mean", 0, 0.1, rows.get(angle.OURS_KNOWN, {}).get("mean_deg")),
        Goal(
            "known shape, no droop, no lean: mean",
            0,
            0.07,
            rows.get(angle.OURS_CLEAN, {}).get("mean_deg"),
        ),
        Goal("known shape: pitch p95", 0, 4, rows.get(angle.OURS_KNOWN, {}).get("pitch_p95_deg")),
    ]


def _of_weather(rows: dict[str, Row]) -> list[Goal]:
    thick = rows.get(fog_row(max(angle.FOG_PER_M)), {})
    return [
        Goal("fog 0.052 /m: refused", 0, 0.05, _share(thick, "refused")),
        Goal("fog 0.052 /m: mean", 0, 0.3, thick.get("mean_deg")),
        Goal("fog 0.052 /m: max", 0, 3.0, thick.get("max_deg")),
        Goal(
            "prior 0-15 m, re-centred: 5 deg failures",
            0,
            0.001,
            _share(rows.get(angle.ACTIVE, {}), "failed_5"),
        ),
        Goal(
            "prior 0-15 m, re-centred: phase p95, s",
            0,
            30,
            rows.get(angle.ACTIVE, {}).get("phase_p95_s"),
        ),
    ]


def _of_paper(rows: dict[str, Row]) -> list[Goal]:
    paper = rows.get(angle.PAPER, {})
    return [
        Goal("the paper's method: mean", 0, 1.15, paper.get("mean_deg")),
        Goal("the paper's method: within 5 deg", 0.983, 1, paper.get("success_5")),
        Goal("the paper's method: ms a pass", 0, 5, paper.get("ms_median")),
    ]


def _share(row: Row, key: str) -> float | None:
    count, trials = row.get(key), row.get("trials")
    return None if count is None or not trials else count / trials


def _worst(parts: list[Row], key: str) -> float | None:
    values = [abs(value) for part in parts if (value := part.get(key)) is not None]
    worst = max(values, default=math.nan)
    return None if math.isnan(worst) else worst
