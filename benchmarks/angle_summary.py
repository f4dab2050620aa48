"""Rows of the angle bench: error, success, refusals, sigma, pitch and time over many trials."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from benchmarks.angle_trials import Trial
from perception.values import Float

STRATA_DEG = tuple(range(0, 90, 15))
RESAMPLES = 1000

Row = dict[str, float | None]


def row(trials: Sequence[Trial]) -> Row:
    """Return one row.

    Errors are over accepted estimates; success counts a refusal as a failure. ``mean_low`` and
    ``mean_high`` bound the mean at 95 % (bootstrap), ``success_1_low`` the success (Wilson).
    """
    good = [t for t in trials if t.error_deg is not None]
    n = len(trials)
    out: Row = {"trials": n, "refused": n - len(good)}
    error = np.array([t.error_deg for t in good], np.float64)
    size = np.abs(error)
    low, high = _bootstrap(size)
    hits = int((size <= 1).sum())
    out |= {
        "mean_deg": _mean(size),
        "mean_low": low,
        "mean_high": high,
        "p95_deg": _percentile(size, 95),
        "p999_deg": _percentile(size, 99.9),
        "max_deg": float(size.max()) if len(size) else None,
        "bias_deg": _mean(error),
        "success_5": float((size <= 5).sum()) / n if n else None,
        "success_1": hits / n if n else None,
        "success_1_low": _wilson_low(hits, n),
        "failed_5": n - int((size <= 5).sum()),
        "looks_mean": _mean(np.array([t.looks for t in trials], np.float64)),
        "phase_p95_s": _percentile(np.array([t.phase_s for t in trials if t.phase_s]), 95),
        "ms_median": _percentile(1e3 * np.array([t.seconds for t in trials]), 50),
        "ms_p95": _percentile(1e3 * np.array([t.seconds for t in trials]), 95),
    }
    return out | _of_geometry(good) | _of_sigma(good) | _of_pitch(good)


def in_strata(trials: Sequence[Trial]) -> dict[int, list[Trial]]:
    """Return the trials of each 15 deg of the blades' median pitch, by its lower end."""
    parts: dict[int, list[Trial]] = {}
    for low in STRATA_DEG:
        part = [t for t in trials if low <= min(max(t.pitch_deg, 0.0), 89.9) < low + 15]
        if part:
            parts[low] = part
    return parts


def strata(trials: Sequence[Trial]) -> dict[str, Row]:
    """Return a row for each 15 deg of the blades' median pitch."""
    return {f"{low}-{low + 15}": row(part) for low, part in in_strata(trials).items()}


def _of_geometry(good: Sequence[Trial]) -> Row:
    def p95(values: list[float]) -> float | None:
        return _percentile(np.abs(values), 95) if values else None

    return {
        "across_p95_m": p95([t.across_m for t in good if t.across_m is not None]),
        "along_p95_m": p95([t.along_m for t in good if t.along_m is not None]),
        "normal_p95_deg": p95([t.normal_deg for t in good if t.normal_deg is not None]),
    }


def _of_sigma(good: Sequence[Trial]) -> Row:
    told = [
        (abs(t.error_deg) / t.sigma_deg, t.sigma_deg)
        for t in good
        if t.sigma_deg is not None and t.error_deg is not None
    ]
    ratio = np.array([r for r, _ in told])
    return {
        "sigma_median_deg": _percentile(np.array([s for _, s in told]), 50),
        "within_1_sigma": _mean((ratio <= 1).astype(np.float64)),
        "within_2_sigma": _mean((ratio <= 2).astype(np.float64)),
        "beyond_4_sigma": _mean((ratio > 4).astype(np.float64)),
    }


def _of_pitch(good: Sequence[Trial]) -> Row:
    told = [e for t in good for e in t.pitch_errors_deg]
    known = np.abs([e for e in told if e is not None])
    return {
        "pitch_p95_deg": _percentile(known, 95),
        "pitch_max_deg": float(known.max()) if len(known) else None,
        "pitch_unknown": (len(told) - len(known)) / len(told) if told else None,
        "pitch_swapped": int((known > 60).sum()) if told else None,
    }


def _mean(values: Float) -> float | None:
    return float(values.mean()) if len(values) else None


def _percentile(values: Float, percent: float) -> float | None:
    return float(np.percentile(values, percent)) if len(values) else None


def _bootstrap(values: Float) -> tuple[float | None, float | None]:
    if len(values) < 2:
        return None, None
    rng = np.random.default_rng(0)
    means = values[rng.integers(len(values), size=(RESAMPLES, len(values)))].mean(axis=1)
    return float(np.percentile(means, 2.5)), float(np.percentile(means, 97.5))


def _wilson_low(hits: int, trials: int) -> float | None:
    if trials == 0:
        return None
    z, share = 1.96, hits / trials
    middle = share + z * z / (2 * trials)
    spread = z * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    return (middle - spread) / (1 + z * z / trials)
