"""The comparison of `bladescout bench angle`: every method on the same turbines and looks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from pathlib import Path

from benchmarks import angle_summary
from benchmarks.angle_active import fly_estimate
from benchmarks.angle_kept import keep_trials
from benchmarks.angle_scenes import SceneOptions, make_scene
from benchmarks.angle_sites import Site
from benchmarks.angle_summary import Row
from benchmarks.angle_trials import (
    PASSES,
    Trial,
    fermat,
    ours,
    three_lines,
    two_lines,
    vision,
    windowed,
)
from benchmarks.blade_family import DRAWN

PAPER_WINDOW_DEG = 60.0
VISION_SHARE = 5
EFFECT_SHARE = 4
"""Pictures and single effects are measured on every so many of the scenes."""
FOG_PER_M = (0.02, 0.035, 0.052)
PRIOR_ERROR_M = (0.0, 15.0)
MODELS = (
    "v27", "nrel-1.79-100", "nrel-2.3-116", "nrel-5mw", "iea-3.4-130", "dtu-10mw", "iea-10-198",
    "iea-15-240", "iea-22-280", DRAWN,
)  # fmt: skip
"""Ten turbine models, each in turn on each of the five sites."""
OURS = "rotor fit, full azimuth, 1 s"
OURS_LONGER = "rotor fit, full azimuth, 2 s"
OURS_NARROW = "rotor fit, 60 deg window, 1 s"
OURS_KNOWN = "rotor fit, full azimuth, 1 s, known shape"
OURS_CLEAN = "known shape, without droop and lean"
PAPER = "fermat, 60 deg window, 1 s"
PAPER_FLOWN = "fermat, 60 deg window, a new second each pass"
TWO_LINES = "two lines (our reading), 60 deg window, 1 s"
THREE_LINES = "three lines (our reading), 60 deg window, 1 s"
VISION = "vision: Hough and vote (our reading), one picture"
PASSIVE = "prior 0-15 m wrong, one look"
ACTIVE = "prior 0-15 m wrong, re-centred"
NOMINAL = (
    OURS, OURS_LONGER, OURS_NARROW, OURS_KNOWN, PAPER, PAPER_FLOWN, TWO_LINES, THREE_LINES, VISION,
)  # fmt: skip
EFFECTS: dict[str, Callable[[SceneOptions], SceneOptions]] = {
    "without droop": lambda o: replace(o, droop=False),
    "without prebend": lambda o: replace(o, prebend=False),
    "without lean of the tower": lambda o: replace(o, lean=False),
    "without uneven bearings": lambda o: replace(o, spacing_deg=0.0),
    "without attitude and mounting errors": lambda o: replace(
        o, attitude_deg=0.0, extrinsic_deg=0.0
    ),
    "without errors of position, sway": lambda o: replace(o, pose_noise_m=0.0, sway_m=0.0),
    "strong wind: sway 0.4 m, attitude 1 deg": lambda o: replace(
        o, sway_m=0.4, attitude_deg=1.0, pose_noise_m=0.06
    ),
    "without mixed returns, range bias": lambda o: replace(o, mixed=False, range_bias_m=0.0),
}


@dataclass(frozen=True, slots=True)
class Table:
    """All trials of a run, by the name of the row."""

    trials: dict[str, list[Trial]] = field(default_factory=dict)

    def add(self, name: str, trial: Trial) -> None:
        """Add an outcome to a row."""
        self.trials.setdefault(name, []).append(trial)

    def merge(self, other: Table) -> None:
        """Add another table's outcomes."""
        for name, trials in other.trials.items():
            self.trials.setdefault(name, []).extend(trials)

    def seeds(self) -> list[int]:
        """Return the first and the last seed."""
        drawn = [trial.seed for trials in self.trials.values() for trial in trials]
        return [min(drawn), max(drawn)]

    def rows(self) -> dict[str, Row]:
        """Return the rows."""
        return {name: angle_summary.row(trials) for name, trials in self.trials.items()}

    def by(self, key: Callable[[Trial], str]) -> dict[str, dict[str, Row]]:
        """Return the nominal rows of each model, or site, or what else a trial is told apart by."""
        groups: dict[str, dict[str, list[Trial]]] = {}
        for name in NOMINAL:
            for trial in self.trials.get(name, []):
                groups.setdefault(key(trial), {}).setdefault(name, []).append(trial)
        return {
            group: {name: angle_summary.row(trials) for name, trials in methods.items()}
            for group, methods in sorted(groups.items())
        }

    def strata(self) -> dict[str, dict[str, Row]]:
        """Return each row by 15 deg of pitch."""
        return {name: angle_summary.strata(trials) for name, trials in self.trials.items()}


def on_a_site(options: SceneOptions, k: int) -> SceneOptions:
    """Return the options of the ``k``-th scene: every model on every site in turn."""
    models = options.models or MODELS
    sites = tuple(Site)
    site = sites[k // len(models) % len(sites)]
    return replace(options, models=(models[k % len(models)],), site=site)


@dataclass(frozen=True, slots=True)
class _Task:
    """One scene of a run, or one loop of re-centring."""

    k: int
    seed: int
    options: SceneOptions
    effects: bool
    active: bool
    core: bool


def measure(
    table: Table,
    trials: int,
    seed: int,
    options: SceneOptions | None = None,
    *,
    effects: bool = True,
    active: int = 0,
    processes: int = 1,
    core: bool = False,
    keep: Path | None = None,
) -> Iterator[int]:
    """Fill a table with the scenes from ``seed`` on and ``active`` loops; yield how many so far.

    ``core``: our fit and the paper's method only; ``keep``: a file that outcomes are appended to.
    """
    nominal = options or SceneOptions()
    tasks = [_Task(k, seed + k, nominal, effects, False, core) for k in range(trials)]
    tasks += [_Task(k, seed + k, nominal, effects, True, core) for k in range(active)]
    for done, part in enumerate(_parts(tasks, processes), start=1):
        table.merge(part)
        if keep is not None:
            keep_trials(keep, part.trials)
        yield done


def _parts(tasks: list[_Task], processes: int) -> Iterator[Table]:
    if processes == 1:
        yield from map(_measured, tasks)
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(_measured, tasks, chunksize=2)


def _measured(task: _Task) -> Table:
    table, placed = Table(), on_a_site(task.options, task.k)
    if task.active:
        first, last = fly_estimate(task.seed, replace(placed, prior_error_m=PRIOR_ERROR_M))
        table.add(PASSIVE, first)
        table.add(ACTIVE, last)
        return table
    one(table, task.seed, placed, pictures=task.k % VISION_SHARE == 0, core=task.core)
    if task.effects and task.k % EFFECT_SHARE == 0:
        _effects(table, task.seed, placed)
        _strata(table, task.seed, placed)
    return table


def one(
    table: Table, seed: int, nominal: SceneOptions, *, pictures: bool, core: bool = False
) -> None:
    """Put one scene to all the methods, or to ours and the paper's (``core``).

    In fog our fit is also given the 2 s that a flight accumulates.
    """
    error_m = nominal.prior_error_m[1]
    scene = make_scene(seed, nominal)
    narrow = windowed(scene, PAPER_WINDOW_DEG)
    table.add(OURS, ours(seed, scene, prior_error_m=error_m))
    table.add(OURS_KNOWN, ours(seed, scene, prior_error_m=error_m, known=True))
    table.add(PAPER, fermat(seed, narrow))
    flown = replace(nominal, seconds=float(PASSES), window_deg=PAPER_WINDOW_DEG)
    table.add(PAPER_FLOWN, fermat(seed, make_scene(seed, flown)))
    if core and nominal.fog_per_m == 0:
        return
    longer = make_scene(seed, replace(nominal, seconds=2 * nominal.seconds))
    table.add(OURS_LONGER, ours(seed, longer, prior_error_m=error_m))
    if core:
        return
    table.add(OURS_NARROW, ours(seed, narrow, prior_error_m=error_m))
    table.add(TWO_LINES, two_lines(seed, narrow))
    table.add(THREE_LINES, three_lines(seed, narrow))
    if pictures:
        table.add(VISION, vision(seed, scene))


def _effects(table: Table, seed: int, nominal: SceneOptions) -> None:
    error_m = nominal.prior_error_m[1]
    for name, change in EFFECTS.items():
        changed = make_scene(seed, change(nominal))
        table.add(name, ours(seed, changed, prior_error_m=error_m))
    clean = make_scene(seed, replace(nominal, droop=False, lean=False))
    table.add(OURS_CLEAN, ours(seed, clean, prior_error_m=error_m, known=True))
    for fog in FOG_PER_M:
        foggy = make_scene(seed, replace(nominal, fog_per_m=fog))
        narrow = windowed(foggy, PAPER_WINDOW_DEG)
        table.add(fog_row(fog), ours(seed, foggy, prior_error_m=error_m))
        table.add(f"fog {fog:g} /m: fermat", fermat(seed, narrow))
        table.add(f"fog {fog:g} /m: three lines", three_lines(seed, narrow))


def _strata(table: Table, seed: int, nominal: SceneOptions) -> None:
    """Put a scene of every 15 deg of pitch to our method: the field mix has few between."""
    for low in angle_summary.STRATA_DEG:
        scene = make_scene(seed, replace(nominal, pitch_deg=(float(low), low + 15.0)))
        trial = ours(seed, scene, prior_error_m=nominal.prior_error_m[1])
        table.add(stratum_row(low), trial)


def fog_row(extinction_per_m: float) -> str:
    """Return the name of our method's row in fog."""
    return f"fog {extinction_per_m:g} /m: rotor fit"


def stratum_row(low_deg: int) -> str:
    """Return the name of our method's row in a stratum of pitch."""
    return f"pitch {low_deg}-{low_deg + 15} deg"
