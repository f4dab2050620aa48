"""One scene, one method, one outcome: what the rows of the angle bench are made of."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.angle_baselines import Outcome, evaluate_line_fit, evaluate_vision
from benchmarks.angle_scenes import AngleScene
from config.settings import Settings
from perception.baselines.line_fit import Variant
from perception.geometry import stop_angle_difference_deg
from perception.rotor import Refusal, RefusalCode, Rotor
from perception.rotor_fit import fit_rotor
from perception.stop_angle import FermatEstimator

PASSES = 6
"""Passes the paper's loop is given: on one cloud, or on one each."""
PRIOR_MARGIN_M = 3.0


@dataclass(frozen=True, slots=True)
class Trial:
    """One outcome; errors in degrees and metres, None where refused or not measured."""

    seed: int
    model: str
    pitch_deg: float
    seconds: float
    refusal: str = ""
    error_deg: float | None = None
    sigma_deg: float | None = None
    across_m: float | None = None
    along_m: float | None = None
    normal_deg: float | None = None
    pitch_errors_deg: tuple[float | None, ...] = ()
    reference: str = ""
    site: str = ""
    looks: int = 1
    phase_s: float | None = None
    """Flown from the first look to the last estimate, where a loop was flown."""


def ours(
    seed: int,
    scene: AngleScene,
    *,
    prior_error_m: float,
    known: bool = False,
    answers: list[Rotor] | None = None,
) -> Trial:
    """Answer by the joint fit; ``answers`` is given the rotor where there is one."""
    start = time.thread_time()  # of the processor: other work on the machine does not count
    answer = fit_rotor(
        scene.points_w,
        scene.origins_w,
        prior_hub_w=scene.prior_hub_w,
        prior_normal_w=scene.prior_normal_w,
        down_w=scene.down_w,
        turbine=scene.turbine if known else None,
        radius_m=scene.radius_m,
        prior_sigma_m=prior_error_m + PRIOR_MARGIN_M,
    )
    took = time.thread_time() - start
    if answers is not None and isinstance(answer, Rotor):
        answers.append(answer)
    return _judged(_blank(seed, scene, took), scene, answer)


def fermat(seed: int, scene: AngleScene) -> Trial:
    """Answer by the paper's loop until two of its angles agree: a pass each second, in turn.

    Where a later pass finds no three blades, the loop keeps what the pass before found, as
    Algorithm 1 keeps p_h^(i-1). A single cloud that shows none would show none again.
    """
    settings = Settings()
    method = FermatEstimator(settings.fermat, agree_deg=settings.estimation.agree_deg)
    second = (scene.time_s + 1e-6).astype(np.int64)
    clouds = [_part(scene, second == k) for k in range(int(second.max(initial=0)) + 1)]
    start = time.thread_time()
    answer: Rotor | Refusal = Refusal(RefusalCode.NO_POINTS, "not looked")
    for k in range(PASSES):
        cloud = clouds[k % len(clouds)]
        found = method.update(cloud.points_w, cloud.origins_w, scene.prior_hub_w)
        if isinstance(found, Rotor) or not isinstance(answer, Rotor):
            answer = found
        if method.converged or (isinstance(found, Refusal) and len(clouds) == 1):
            break
    took = (time.thread_time() - start) / method.iterations
    return _judged(_blank(seed, scene, took), scene, answer)


def two_lines(seed: int, scene: AngleScene) -> Trial:
    """Answer by plane and two lines (our reading of a published method)."""
    return _of(seed, scene, lambda: evaluate_line_fit(scene, Variant.TWO_LINES))


def three_lines(seed: int, scene: AngleScene) -> Trial:
    """Answer by plane and three lines bound to 120 deg."""
    return _of(seed, scene, lambda: evaluate_line_fit(scene, Variant.THREE_LINES))


def vision(seed: int, scene: AngleScene) -> Trial:
    """Answer by Hough lines and a vote on a picture (our reading of a published method)."""
    return _of(seed, scene, lambda: evaluate_vision(scene, seed))


def windowed(scene: AngleScene, window_deg: float) -> AngleScene:
    """Return the scene with the returns of a horizontal window about the prior axis only."""
    ray = scene.points_w - scene.origins_w
    ahead = math.atan2(scene.prior_normal_w[1], scene.prior_normal_w[0])
    turn = np.arctan2(ray[:, 1], ray[:, 0]) - ahead
    keep = np.abs((turn + np.pi) % (2 * np.pi) - np.pi) <= math.radians(window_deg / 2)
    return _part(scene, keep)


def _part(scene: AngleScene, keep: NDArray[np.bool_]) -> AngleScene:
    return replace(
        scene,
        points_w=scene.points_w[keep],
        origins_w=scene.origins_w[keep],
        time_s=scene.time_s[keep],
    )


def _blank(seed: int, scene: AngleScene, seconds: float) -> Trial:
    pitch_deg = float(np.median(scene.pitch_deg))
    return Trial(seed, scene.plan.model, pitch_deg, seconds, site=scene.site)


def _of(seed: int, scene: AngleScene, answer: Callable[[], Outcome]) -> Trial:
    start = time.thread_time()
    outcome = answer()
    trial = _blank(seed, scene, min(outcome.seconds, time.thread_time() - start))
    if outcome.angle_deg is None:
        return replace(trial, refusal=outcome.refusal)
    error = stop_angle_difference_deg(outcome.angle_deg, scene.stop_angle_deg)
    return replace(trial, error_deg=error)


def _judged(trial: Trial, scene: AngleScene, answer: Rotor | Refusal) -> Trial:
    if isinstance(answer, Refusal):
        return replace(trial, refusal=f"{answer.code}: {answer.text}")
    off = answer.hub_w - scene.hub_w
    along = float(off @ scene.normal_w)
    errors: list[float | None] = []
    for blade in answer.blades:
        k = int(np.argmax(scene.directions_w @ blade.direction_w))
        errors.append(None if blade.pitch_deg is None else blade.pitch_deg - scene.pitch_deg[k])
    cosine = float(np.clip(answer.normal_w @ scene.normal_w, -1, 1))
    return replace(
        trial,
        error_deg=stop_angle_difference_deg(answer.stop_angle_deg, scene.stop_angle_deg),
        sigma_deg=answer.sigma_deg,
        across_m=float(np.linalg.norm(off - along * scene.normal_w)),
        along_m=along,
        normal_deg=math.degrees(math.acos(cosine)),
        pitch_errors_deg=tuple(errors),
        reference=answer.reference,
    )
