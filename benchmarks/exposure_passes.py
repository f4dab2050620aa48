"""Root to tip along the upper and the lower surface, in every light: the paper's table, and more.

All methods see the same looks. Live frames steer; a still is taken every tenth frame with the
exposure then in force, and judged by the true blade in it: mean, sigma and entropy of the grey,
and the contrast-to-noise of defects put on it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from benchmarks.exposure_camera import BenchCamera, CameraKind, Curve
from benchmarks.exposure_defects import (
    Contrast,
    Defect,
    contrast_to_noise,
    draw_defects,
    with_defects,
)
from benchmarks.exposure_methods import AUTOMATIC, CHOICES, CLAHE, OURS, Maker, left_alone, ours
from benchmarks.exposure_play import MAX_GREY, MIN_GREY, Player, Region
from benchmarks.exposure_scene import Lighting, Looks, Shown, Surface
from drivers.simulated.camera_model import exposure_of, motion_blur
from perception.baselines.exposure_clahe import equalised
from perception.values import Bytes

OURS_BIASED = "ours, on the automatic"
FRAMES, FPS, EVERY = 120, 10, 10
#: Frames of the first look before the pass: the way to it, without a photo.
LEAD = 60
LIVE_PX, STILL_PX = (160, 120), (640, 480)
LATENCY_S = 0.2
#: Of a camera at its full size, flown along at this speed: for the motion blur.
SPEED_MPS, GSD_M = 1.2, 0.0009
CLIP_LIMIT = 2.0


@dataclass(frozen=True, slots=True)
class Still:
    """One still, judged by its true blade."""

    metre: float
    mean: float
    sigma: float
    entropy_nats: float
    contrasts: tuple[Contrast, ...]
    with_clahe: tuple[Contrast, ...]


@dataclass(slots=True)
class Pass:
    """One method along one surface in one light."""

    method: str
    surface: Surface
    lighting: Lighting
    stills: list[Still] = field(default_factory=list)
    outside: int = 0
    """Live frames out of range."""


@dataclass(frozen=True, slots=True)
class _Runner:
    name: str
    player: Player
    clip_limit: float | None
    made: Pass


def fly(looks: Looks, seed: int, chosen: dict[str, str]) -> Iterator[Pass]:
    """Fly every pass with every method at its chosen settings; yield what came of each."""
    for count, (surface, lighting) in enumerate(
        (surface, lighting) for lighting in Lighting for surface in Surface
    ):
        curve = tuple(Curve)[(seed + count) % 3]
        makers = {name: (CHOICES[name][label], True) for name, label in chosen.items()}
        makers[OURS_BIASED] = (ours, False)
        makers[AUTOMATIC] = (left_alone, False)
        yield from _one(looks, surface, lighting, curve, makers, seed, FRAMES, stills=True)


def choose(looks: Looks, seed: int) -> dict[str, str]:
    """Return for every method the settings that keep the blade in range most, on other passes."""
    trials = [(Surface.UPPER, Lighting.CLOUDS), (Surface.LOWER, Lighting.BACKLIGHT)]
    cost: dict[tuple[str, str], float] = {}
    for surface, lighting in trials:
        makers = {
            f"{name}|{label}": (maker, True)
            for name, choices in CHOICES.items()
            if len(choices) > 1
            for label, maker in choices.items()
        }
        done = _one(looks, surface, lighting, Curve.GAMMA, makers, seed + 7, 40, stills=False)
        for one in done:
            name, label = one.method.split("|")
            cost[name, label] = cost.get((name, label), 0.0) + one.outside
    best = {name: next(iter(choices)) for name, choices in CHOICES.items()}
    for name in best:
        labels = [label for other, label in cost if other == name]
        if labels:
            best[name] = min((cost[name, label], label) for label in labels)[1]
    return best


def _one(
    looks: Looks,
    surface: Surface,
    lighting: Lighting,
    curve: Curve,
    makers: dict[str, tuple[Maker, bool]],
    seed: int,
    frames: int,
    *,
    stills: bool,
) -> list[Pass]:
    """Fly all methods side by side, so that every look is drawn once."""
    rng = np.random.default_rng([seed, 0x9A])
    runners = []
    for name, (make, manual) in makers.items():
        kind = CameraKind(curve, manual, LATENCY_S)
        player = Player(make(manual), BenchCamera(kind, seed))
        runners.append(_Runner(name, player, None, Pass(name, surface, lighting)))
    for k in range(-LEAD, frames):
        # Before the pass the first look, while no photo is near.
        share, t_s = max(k, 0) / (frames - 1), (k + LEAD) / FPS
        light = looks.light(surface, lighting, share)
        shown = looks.show(surface, light, share, *LIVE_PX)
        region = Region.of(shown.blade, float(rng.uniform(-1, 1)))
        for runner in runners:
            runner.player.frame(shown.radiance, region, t_s, spare=k < 0)
        if stills and k >= 0 and k % EVERY == EVERY - 1:
            look = looks.show(surface, light, share, *STILL_PX)
            defects = draw_defects(look.blade, rng)
            for runner in runners:
                still = _still(look, defects, runner.player.camera, t_s, looks.metre(share))
                runner.made.stills.append(still)
    for runner in runners:
        runner.made.outside = int(runner.player.record.outside()[LEAD:].sum())
    return [runner.made for runner in runners]


def _still(
    look: Shown, defects: list[Defect], camera: BenchCamera, t_s: float, metre: float
) -> Still:
    ev = camera.total_ev(t_s)
    blur_px = SPEED_MPS * exposure_of(ev).shutter_s / GSD_M
    radiance = motion_blur(with_defects(look.radiance, defects), blur_px, 0.0)
    grey = camera.photo(radiance, ev)
    values = grey[look.blade]
    processed = equalised(grey, CLIP_LIMIT)
    return Still(
        metre,
        float(values.mean()),
        float(values.std()),
        entropy_nats(values),
        contrast_to_noise(grey, look.blade, defects),
        contrast_to_noise(processed, look.blade, defects, taken=grey),
    )


def entropy_nats(values: Bytes) -> float:
    """Return the entropy of greys (N,), in nats as the paper's table has it."""
    counts = np.bincount(values.ravel(), minlength=256)
    share = counts[counts > 0] / values.size
    return float(-(share * np.log(share)).sum())


@dataclass(frozen=True, slots=True)
class Line:
    """A row of the table: means over the stills of some passes."""

    method: str
    case: str
    mean: float
    sigma: float
    entropy_nats: float
    in_range: float
    """Share of the stills."""
    outside: int
    cnr: float
    """Mean over the defects."""
    cnr_clahe: float
    """The same after CLAHE."""


def lines(passes: list[Pass]) -> list[Line]:
    """Return a row for each method, surface and light."""
    rows = [_line(one.method, f"{one.surface}, {one.lighting}", [one]) for one in passes]
    automatic = [
        (one, row) for one, row in zip(passes, rows, strict=True) if one.method == AUTOMATIC
    ]
    # CLAHE works on what the automatic took.
    for one, row in automatic:
        rows.append(
            Line(
                CLAHE, row.case, math.nan, math.nan, math.nan, math.nan, one.outside,
                row.cnr_clahe, row.cnr_clahe,
            )
        )  # fmt: skip
    return rows


def _line(method: str, case: str, passes: list[Pass]) -> Line:
    stills = [still for one in passes for still in one.stills]
    plain = [contrast.cnr for still in stills for contrast in still.contrasts]
    clahe = [contrast.cnr for still in stills for contrast in still.with_clahe]
    inside = [MIN_GREY <= still.mean <= MAX_GREY for still in stills]
    return Line(
        method,
        case,
        float(np.mean([still.mean for still in stills])),
        float(np.mean([still.sigma for still in stills])),
        float(np.mean([still.entropy_nats for still in stills])),
        float(np.mean(inside)),
        sum(one.outside for one in passes),
        float(np.mean(plain)) if plain else 0.0,
        float(np.mean(clahe)) if clahe else 0.0,
    )


@dataclass(frozen=True, slots=True)
class Verdict:
    """How the defects' contrast of ours stands over all lights and surfaces."""

    mean: float
    best_mean: tuple[str, float]
    """Of the other methods."""
    worst: float
    best_worst: tuple[str, float]
    least_of_best: tuple[str, float]
    """Case in which ours is the least share of the best other method, and that share."""
    least_of_paper: tuple[str, float]


def verdict(rows: list[Line], paper: str, *, clahe: bool) -> Verdict:
    """Return the comparison, CLAHE applied to every method or to none."""
    cases: dict[str, dict[str, float]] = {}
    for row in rows:
        if row.method not in (OURS_BIASED, CLAHE):
            cases.setdefault(row.case, {})[row.method] = row.cnr_clahe if clahe else row.cnr
    others = [name for name in next(iter(cases.values())) if name != OURS]
    mean = {name: float(np.mean([case[name] for case in cases.values()])) for name in others}
    worst = {name: min(case[name] for case in cases.values()) for name in others}
    of_best = {
        name: case[OURS] / max(case[other] for other in others) for name, case in cases.items()
    }
    of_paper = {name: case[OURS] / case[paper] for name, case in cases.items()}
    ours_cnr = [case[OURS] for case in cases.values()]
    return Verdict(
        float(np.mean(ours_cnr)),
        max(mean.items(), key=lambda item: item[1]),
        min(ours_cnr),
        max(worst.items(), key=lambda item: item[1]),
        min(of_best.items(), key=lambda item: item[1]),
        min(of_paper.items(), key=lambda item: item[1]),
    )
