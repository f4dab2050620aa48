"""`bladescout bench exposure`: every method on the same light, goals beside the figures."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np

from benchmarks.exposure_methods import CHOICES, OURS, PAPER
from benchmarks.exposure_passes import Line, Pass, Verdict, choose, fly, lines, verdict
from benchmarks.exposure_scene import TURBINE, Looks, Surface
from benchmarks.exposure_steps import Outcome, best_choice, events, play, standing_look
from config.inspection import Exposure
from config.presets import turbines_of
from config.settings import Settings
from config.turbine import Site
from mission.flight.command import SensingMode, SensingTask
from mission.processes.blade_metering import BladeMetering
from perception.exposure import exposure_control
from perception.geometry import camera_looking_along, pinhole_matrix
from perception.metering import blade_outline, histogram_of
from perception.values import CameraPose, Frame

#: Latencies (frames) at which a ramp of 3 EV in 30 frames may cost nothing, and at most three.
_QUICK, _MIDDLE = 2, 4
LOOP_GOAL_MS = 1.0


@dataclass(frozen=True, slots=True)
class Goal:
    """A figure beside what it ought to be."""

    name: str
    value: str
    goal: str
    met: bool | None
    """None: nothing to meet."""


@dataclass(slots=True)
class Bench:
    """All that was measured."""

    outcomes: dict[str, list[Outcome]] = field(default_factory=dict)
    passes: list[Pass] = field(default_factory=list)
    chosen_for_steps: dict[str, str] = field(default_factory=dict)
    chosen_for_passes: dict[str, str] = field(default_factory=dict)
    loop_ms: float = 0.0

    def lines(self) -> list[Line]:
        """Return the rows of the paper's table."""
        return lines(self.passes)

    def verdict(self, *, clahe: bool) -> Verdict:
        """Return how the contrast of defects stands."""
        return verdict(self.lines(), PAPER, clahe=clahe)


def measure(bench: Bench, seed: int, trials: int = 1, *, steps_only: bool = False) -> Iterator[str]:
    """Fill a bench; yield what was done.

    ``steps_only``: steps and ramps of ours and of the paper's method, nothing else.
    """
    bench.loop_ms = loop_ms()
    looks = Looks(seed)
    shown = [standing_look(looks, surface, seed) for surface in Surface]
    for name in (OURS, PAPER) if steps_only else CHOICES:
        label = best_choice(name, shown[1], seed)
        bench.chosen_for_steps[name] = label
        make = CHOICES[name][label]
        found = bench.outcomes.setdefault(name, [])
        for trial in range(trials):
            for k, event in enumerate(events(seed + trial)):
                found.append(play(event, make, shown[k % 2], seed + 1000 * trial + k))
        yield f"steps and ramps: {name}"
    if steps_only:
        return
    bench.chosen_for_passes = choose(looks, seed)
    yield "settings for the passes"
    for one in fly(looks, seed, bench.chosen_for_passes):
        bench.passes.append(one)
        yield f"passes: {one.surface}, {one.lighting}"


def loop_ms() -> float:
    """Return the CPU time (median, ms) of one loop on 1080p: find, mask, meter, control."""
    root_w, tip_w = np.zeros(3), np.array([50.0, 0.0, 0.0])
    settings = Settings(sites=(Site(name="bench", turbine=TURBINE),))
    metering = BladeMetering(settings, turbines_of(settings.sites))
    task = SensingTask(
        SensingMode.BLADE, 1, turbine="bench", blade_root_w=(0.0, 0.0, 0.0),
        blade_tip_w=(50.0, 0.0, 0.0),
    )  # fmt: skip
    sight = np.array([0.0, 1.0, 0.0])
    pose = CameraPose(0.0, np.array([20.0, -12.0, 0.3]), camera_looking_along(sight))
    focal_px = settings.camera.focal_length_mm / settings.camera.sensor_width_mm * 1920
    outline = blade_outline(root_w, tip_w, 0.8, pose, pinhole_matrix(focal_px, 1920, 1080))
    if outline is None:
        raise ValueError("the blade is not before the camera")
    grey = np.random.default_rng(3).integers(70, 90, (1080, 1920), dtype=np.uint8)
    cv2.fillPoly(grey, [np.round(outline).astype(np.int32)], 140)
    control = exposure_control(Exposure())
    control.confirmed(0.0, -1.0)
    taken = []
    for k in range(60):
        stamp_s = 0.1 * (k + 1)
        start = time.process_time()
        found = metering.meter(Frame(stamp_s, k, grey), pose, task, None)
        if found is not None and found.metered is not None:
            control.update(found.metered, stamp_s, histogram_of(grey))
        taken.append(time.process_time() - start)
    return float(np.median(taken)) * 1e3


def goals(bench: Bench) -> list[Goal]:
    """Return the goals and how they stand."""
    own = bench.outcomes[OURS]
    steps = [one for one in own if one.event.frames == 1]
    ramps = [one for one in own if one.event.frames > 1]
    found = []
    for clipped, factor in ((False, "latency + 1"), (True, "2 (latency + 1)")):
        part = [one for one in steps if one.clipped is clipped]
        late = [one for one in part if not one.within_goal]
        name = f"steps of 2-4 EV, {'clipped' if clipped else 'not clipped'}: more than {factor}"
        found.append(_count(f"{name} frames outside", len(late), len(part)))
    over = sum(one.beyond > 0 for one in steps)
    found.append(_count("steps that overshot the range", over, len(steps)))
    quick = [one.outside for one in ramps if _frames(one) <= _QUICK]
    middle = [one.outside for one in ramps if _QUICK < _frames(one) <= _MIDDLE]
    for words, frames, most in (
        (f"up to {_QUICK} frames", quick, 0),
        (f"{_QUICK + 1}-{_MIDDLE} frames", middle, 3),
    ):
        worst = max(frames, default=0)
        name = f"ramps of 3 EV in 30 frames, latency {words}: frames outside, mean / worst"
        value = f"{float(np.mean(frames)) if frames else 0.0:.2f} / {worst}"
        found.append(Goal(name, value, f"<= {most}", worst <= most))
    restless = sum(one.restless > 0 for one in own)
    found.append(_count("out of range 2 s after (limit cycles)", restless, len(own)))
    for clahe in (False, True) if bench.passes else ():
        found += _contrast(bench.verdict(clahe=clahe), "all with CLAHE" if clahe else "no CLAHE")
    met = bench.loop_ms <= LOOP_GOAL_MS
    name = "one loop on 1080p: project, mask, meter, control; CPU ms"
    found.append(Goal(name, f"{bench.loop_ms:.2f}", f"<= {LOOP_GOAL_MS:g}", met))
    return found


def _frames(one: Outcome) -> int:
    """Return the latency in frames: those between a frame and the first that its answer exposes."""
    event = one.event
    return int(np.ceil(event.kind.latency_s * event.fps - 1e-6)) - 1


def _count(name: str, bad: int, of: int) -> Goal:
    return Goal(name, f"{bad} of {of}", "0", bad == 0)


def _contrast(verdict: Verdict, words: str) -> list[Goal]:
    best, worst = verdict.best_mean, verdict.best_worst
    case, share = verdict.least_of_best
    paper_case, paper_share = verdict.least_of_paper
    return [
        Goal(
            f"defect CNR, {words}: mean over the cases",
            f"{verdict.mean:.2f}",
            f"best other {best[1]:.2f} ({best[0]})",
            verdict.mean >= best[1],
        ),
        Goal(
            f"defect CNR, {words}: worst case",
            f"{verdict.worst:.2f}",
            f"best other {worst[1]:.2f} ({worst[0]})",
            verdict.worst >= worst[1],
        ),
        Goal(
            f"defect CNR, {words}: least share of the best other ({case})",
            f"{share:.2f}",
            ">= 0.85",
            share >= 0.85,
        ),
        Goal(
            f"defect CNR, {words}: least share of the paper's ({paper_case})",
            f"{paper_share:.2f}",
            ">= 1",
            paper_share >= 1.0,
        ),
    ]
