"""The comparison of `bladescout bench angle`: every method on the same turbines and looks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

from benchmarks import angle_summary
from benchmarks.angle_scenes import AngleScene, SceneOptions, make_scene
from benchmarks.angle_summary import Row
from benchmarks.angle_trials import (
    Trial,
    fermat,
    ours,
    three_lines,
    two_lines,
    vision,
    windowed,
)

PAPER_WINDOW_DEG = 60.0
VISION_SHARE = 5
EFFECT_SHARE = 4
"""Pictures and single effects are measured on every so many of the scenes."""
FOG_PER_M = (0.02, 0.035, 0.052)
EFFECTS: dict[str, Callable[[SceneOptions], SceneOptions]] = {
    "without droop": lambda o: replace(o, droop=False),
    "without prebend": lambda o: replace(o, prebend=False),
    "without lean of the tower": lambda o: replace(o, lean=False),
    "without uneven bearings": lambda o: replace(o, spacing_deg=0.0),
    "without attitude and mounting errors": lambda o: replace(
        o, attitude_deg=0.0, extrinsic_deg=0.0
    ),
    "without errors of position, sway": lambda o: replace(o, pose_noise_m=0.0, sway_m=0.0),
    "without mixed returns, range bias": lambda o: replace(o, mixed=False, range_bias_m=0.0),
}


@dataclass(frozen=True, slots=True)
class Table:
    """All trials of a run, by the name of the row."""

    trials: dict[str, list[Trial]] = field(default_factory=dict)

    def add(self, name: str, trial: Trial) -> None:
        """Add an outcome to a row."""
        self.trials.setdefault(name, []).append(trial)

    def rows(self) -> dict[str, Row]:
        """Return the rows."""
        return {name: angle_summary.row(trials) for name, trials in self.trials.items()}

    def strata(self) -> dict[str, dict[str, Row]]:
        """Return each row by 15 deg of pitch."""
        return {name: angle_summary.strata(trials) for name, trials in self.trials.items()}


def measure(
    table: Table,
    trials: int,
    seed: int,
    options: SceneOptions | None = None,
    *,
    effects: bool = True,
) -> Iterator[int]:
    """Fill a table scene by scene from ``seed`` on; yield how many are done."""
    nominal = options or SceneOptions()
    for k in range(trials):
        one(table, seed + k, nominal, pictures=k % VISION_SHARE == 0)
        if effects and k % EFFECT_SHARE == 0:
            _effects(table, seed + k, nominal)
        yield k + 1


def one(table: Table, seed: int, nominal: SceneOptions, *, pictures: bool) -> None:
    """Put one scene to all the methods."""
    error_m = nominal.prior_error_m[1]
    scene = make_scene(seed, nominal)
    longer = make_scene(seed, replace(nominal, seconds=2 * nominal.seconds))
    narrow = windowed(scene, PAPER_WINDOW_DEG)
    table.add("rotor fit, 60 deg window, 1 s", ours(seed, narrow, prior_error_m=error_m))
    table.add("rotor fit, full azimuth, 1 s", ours(seed, scene, prior_error_m=error_m))
    table.add("rotor fit, full azimuth, 2 s", ours(seed, longer, prior_error_m=error_m))
    known = ours(seed, scene, prior_error_m=error_m, known=True)
    table.add("rotor fit, full azimuth, 1 s, known shape", known)
    table.add("fermat, 60 deg window, 1 s", fermat(seed, narrow))
    table.add("two lines (our reading), 60 deg window, 1 s", two_lines(seed, narrow))
    table.add("three lines (our reading), 60 deg window, 1 s", three_lines(seed, narrow))
    if pictures:
        table.add("vision: Hough and vote (our reading), one picture", vision(seed, scene))


def _effects(table: Table, seed: int, nominal: SceneOptions) -> None:
    error_m = nominal.prior_error_m[1]

    def fitted(changed: SceneOptions, *, known: bool = False) -> Trial:
        scene: AngleScene = make_scene(seed, changed)
        return ours(seed, scene, prior_error_m=error_m, known=known)

    for name, change in EFFECTS.items():
        table.add(name, fitted(change(nominal)))
    clean = replace(nominal, droop=False, lean=False)
    table.add("known shape, without droop and lean", fitted(clean, known=True))
    for fog in FOG_PER_M:
        table.add(f"fog {fog:g} /m", fitted(replace(nominal, fog_per_m=fog)))
