"""Whole missions, one after the other, in real processes: what `bladescout simulate` reports.

Each seed draws its own turbine stand, wind and launch point; 0, 60 and 119.95 degrees, where the
names of the blades change, are among the stop angles. A mission is kept as a line of a file, so
that a long run goes on where it was broken off.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random

import numpy as np

TIMEOUT_S = 1800.0
#: Stop angles of the first missions of a run: where blades hang straight, or change their names.
EDGES_DEG = (0.0, 60.0, 119.95)


@dataclass(frozen=True, slots=True)
class Flown:
    """One mission as it ended."""

    seed: int
    state: str
    words: str
    exit_code: int
    stop_angle_deg: float | None
    """The true one."""
    error_deg: float | None
    sigma_deg: float | None
    clearance_m: float | None
    """Least distance to the true mesh."""
    coverage: float
    kept: int
    simulated_s: float
    estimate_s: float | None
    """From arrival before the hub to the converged angle."""
    gap_p99_ms: float | None
    factor: float | None


def seeds_of(count: int, first: int | None) -> list[int]:
    """Return the seeds of a run: consecutive from the first, or drawn anew each time."""
    if first is not None:
        return list(range(first, first + count))
    draw = Random()
    return [draw.randrange(1, 1_000_000) for _ in range(count)]


def fly(
    seeds: Sequence[int], scenario: str, overrides: Sequence[str], kept_in: Path, *, edges: bool
) -> Iterator[Flown]:
    """Fly each seed and yield how it ended; those in ``kept_in``/flown.jsonl are not flown again.

    ``overrides``: `--set` words for every mission; ``edges``: begin with the stop angles of
    `EDGES_DEG`.
    """
    kept_in.mkdir(parents=True, exist_ok=True)
    lines = kept_in / "flown.jsonl"
    done = {one.seed: one for one in _read(lines)}
    for index, seed in enumerate(seeds):
        if seed not in done:
            own = list(overrides)
            if edges and index < len(EDGES_DEG):
                own.append(f"simulation.truth.stop_angle_deg={EDGES_DEG[index]}")
            done[seed] = _one(seed, scenario, own, kept_in)
            with lines.open("a") as file:
                file.write(json.dumps(asdict(done[seed])) + "\n")
        yield done[seed]


def _read(lines: Path) -> list[Flown]:
    if not lines.exists():
        return []
    return [Flown(**json.loads(line)) for line in lines.read_text().splitlines() if line]


class NotFlown(RuntimeError):
    """`simulate` ended without a mission's figures."""

    def __init__(self, words: str, exit_code: int) -> None:
        """``words``: what it said last."""
        super().__init__(words)
        self.exit_code = exit_code


def simulate(words: Sequence[str], timeout_s: float = TIMEOUT_S) -> tuple[dict[str, object], int]:
    """Run `bladescout simulate` in a process of its own; return mission.json and the exit code.

    Raises `NotFlown` where there is none.
    """
    command = [sys.executable, "-m", "mission.cli.main", "simulate", *words, "--json"]
    try:
        ran = subprocess.run(
            command, capture_output=True, text=True, timeout=timeout_s, check=False
        )
    except subprocess.TimeoutExpired:
        raise NotFlown(f"no end within {timeout_s:.0f} s", 1) from None
    try:
        told = json.loads(ran.stdout)
    except ValueError:
        last = (ran.stderr.strip().splitlines() or ["nothing was said"])[-1]
        raise NotFlown(last, ran.returncode) from None
    if "state" not in told:
        raise NotFlown(told["error"], ran.returncode)
    return told, ran.returncode


def _one(seed: int, scenario: str, overrides: list[str], kept_in: Path) -> Flown:
    words = [scenario, "--seed", str(seed), "--out", str(kept_in)]
    for override in overrides:
        words += ["--set", override]
    try:
        return summary(seed, *simulate(words))
    except NotFlown as error:
        return _unflown(seed, str(error), error.exit_code)


def _unflown(seed: int, words: str, exit_code: int) -> Flown:
    nothing = (None,) * 4
    return Flown(seed, "failed", words, exit_code, *nothing, 0.0, 0, 0.0, None, None, None)


def summary(seed: int, mission: dict[str, object], exit_code: int) -> Flown:
    """Return what a mission's ``mission.json`` says, as one line."""
    get = _Reader(mission)
    phases = mission.get("phases")
    spans = phases if isinstance(phases, list) else []
    estimate = [p["to_s"] - p["from_s"] for p in spans if p["phase"] == "estimate"]
    return Flown(
        seed=seed,
        state=str(mission.get("state")),
        words=str(mission.get("words")),
        exit_code=exit_code,
        stop_angle_deg=get("truth", "stop_angle_deg"),
        error_deg=get("errors", "stop_angle_deg"),
        sigma_deg=get("rotor", "sigma_deg"),
        clearance_m=get("truth", "min_clearance_m"),
        coverage=get("coverage") or 0.0,
        kept=round(get("photos", "kept") or 0),
        simulated_s=get("duration_s") or 0.0,
        estimate_s=estimate[0] if estimate else None,
        gap_p99_ms=get("timing", "setpoint_gap_ms", "p99"),
        factor=get("timing", "real_time_factor"),
    )


class _Reader:
    """Numbers out of nested objects, None where there are none."""

    def __init__(self, mission: dict[str, object]) -> None:
        self._mission = mission

    def __call__(self, *keys: str) -> float | None:
        value: object = self._mission
        for key in keys:
            value = value.get(key) if isinstance(value, dict) else None
        return float(value) if isinstance(value, int | float) else None


def figures(flown: Sequence[Flown]) -> dict[str, float | None]:
    """Return the figures of a run: how many completed, and the spread of what they measured."""
    errors = np.abs([one.error_deg for one in flown if one.error_deg is not None])
    looks = [one.estimate_s for one in flown if one.estimate_s is not None]
    clear = [one.clearance_m for one in flown if one.clearance_m is not None]
    return {
        "missions": len(flown),
        "completed": sum(one.state == "completed" for one in flown),
        "error_median_deg": float(np.median(errors)) if len(errors) else None,
        "error_p95_deg": float(np.quantile(errors, 0.95)) if len(errors) else None,
        "error_max_deg": float(errors.max()) if len(errors) else None,
        "estimate_median_s": float(np.median(looks)) if looks else None,
        "estimate_max_s": max(looks, default=None),
        "clearance_min_m": min(clear, default=None),
        "simulated_max_s": max((one.simulated_s for one in flown), default=None),
        "gap_p99_max_ms": max((o.gap_p99_ms for o in flown if o.gap_p99_ms), default=None),
    }
