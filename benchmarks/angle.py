"""Error of the stop angle over drawn scenes: `python -m benchmarks.angle --trials N`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.angle_scenes import AngleScene, SceneOptions, make_scene
from perception.geometry import stop_angle_difference_deg
from perception.rotor import Refusal, Rotor
from perception.rotor_fit import fit_rotor
from perception.values import Float

STRATA_DEG = tuple(range(0, 90, 15))


@dataclass(frozen=True, slots=True)
class Trial:
    """One scene's outcome; errors in degrees and metres, NaN where refused."""

    seed: int
    pitch_deg: float
    refusal: str
    text: str
    error_deg: float
    sigma_deg: float
    across_m: float
    along_m: float
    normal_deg: float
    pitch_errors_deg: tuple[float | None, ...]
    reference: str
    time_s: float


def run_trial(seed: int, options: SceneOptions, *, shape_known: bool, prior: bool) -> Trial:
    """Estimate one scene and compare with its truth."""
    scene = make_scene(seed, options)
    start = time.thread_time()  # of the processor: other work on the machine does not count
    answer = fit_rotor(
        scene.points_w,
        scene.origins_w,
        prior_hub_w=scene.prior_hub_w if prior else None,
        prior_normal_w=scene.prior_normal_w if prior else None,
        down_w=scene.down_w,
        turbine=scene.turbine if shape_known else None,
        radius_m=scene.radius_m,
        prior_sigma_m=options.prior_error_m[1] + 3.0,
    )
    took = time.thread_time() - start
    pitch = float(np.median(scene.pitch_deg))
    if isinstance(answer, Refusal):
        nan = float("nan")
        return Trial(seed, pitch, answer.code, answer.text, nan, nan, nan, nan, nan, (), "", took)
    return _judged(seed, pitch, scene, answer, took)


def _judged(seed: int, pitch: float, scene: AngleScene, rotor: Rotor, took: float) -> Trial:
    error = stop_angle_difference_deg(rotor.stop_angle_deg, scene.stop_angle_deg)
    off = rotor.hub_w - scene.hub_w
    along = float(off @ scene.normal_w)
    across = float(np.linalg.norm(off - along * scene.normal_w))
    turned = float(np.degrees(np.arccos(np.clip(rotor.normal_w @ scene.normal_w, -1, 1))))
    errors: list[float | None] = []
    for blade in rotor.blades:
        k = int(np.argmax(scene.directions_w @ blade.direction_w))
        errors.append(None if blade.pitch_deg is None else blade.pitch_deg - scene.pitch_deg[k])
    return Trial(
        seed,
        pitch,
        "",
        "",
        error,
        rotor.sigma_deg,
        across,
        along,
        turned,
        tuple(errors),
        rotor.reference,
        took,
    )


def summary(trials: list[Trial]) -> dict[str, float]:
    """Return the row of a table."""
    good = [t for t in trials if not t.refusal]
    error = np.array([t.error_deg for t in good])
    size = np.abs(error)
    pitch = np.array([e for t in good for e in t.pitch_errors_deg if e is not None])
    unknown = sum(e is None for t in good for e in t.pitch_errors_deg)
    ratio = size / np.array([t.sigma_deg for t in good])
    times = np.array([t.time_s for t in trials])
    if not good:
        return {"trials": len(trials), "refused": len(trials)}
    return {
        "trials": len(trials),
        "refused": len(trials) - len(good),
        "mean": float(size.mean()),
        "p95": _p(size, 95),
        "max": float(size.max()),
        "bias": float(error.mean()),
        "success_5": float((size <= 5).sum() / len(trials)),
        "success_1": float((size <= 1).sum() / len(trials)),
        "across_p95": _p(np.array([t.across_m for t in good]), 95),
        "along_p95": _p(np.abs([t.along_m for t in good]), 95),
        "normal_p95": _p(np.array([t.normal_deg for t in good]), 95),
        "pitch_p95": _p(np.abs(pitch), 95),
        "pitch_max": float(np.abs(pitch).max(initial=0)),
        "pitch_none": unknown,
        "sigma_1": float((ratio <= 1).mean()),
        "sigma_2": float((ratio <= 2).mean()),
        "sigma_median": _p(size / ratio, 50),
        "ms_median": 1e3 * _p(times, 50),
        "ms_p95": 1e3 * _p(times, 95),
    }


def _p(values: Float, percent: float) -> float:
    return float(np.percentile(values, percent)) if len(values) else float("nan")


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1000, help="first seed")
    parser.add_argument("--known", action="store_true", help="blade shape known")
    parser.add_argument("--no-prior", action="store_true")
    parser.add_argument("--prior-error", type=float, default=3.0)
    parser.add_argument("--stand-off", type=float, nargs=2, default=(20.0, 30.0))
    parser.add_argument("--pitch", type=float, nargs=2, default=None)
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--fog", type=float, default=0.0)
    parser.add_argument("--window", type=float, default=360.0)
    parser.add_argument("--clean", action="store_true", help="no droop, no lean")
    parser.add_argument("--worst", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    options = SceneOptions(
        stand_off_m=(args.stand_off[0], args.stand_off[1]),
        prior_error_m=(0.0, args.prior_error),
        pitch_deg=None if args.pitch is None else (args.pitch[0], args.pitch[1]),
        seconds=args.seconds,
        fog_per_m=args.fog,
        window_deg=args.window,
        droop=not args.clean,
        lean=not args.clean,
    )
    trials = [
        run_trial(args.seed + i, options, shape_known=args.known, prior=not args.no_prior)
        for i in range(args.trials)
    ]
    _print(trials, args.worst, as_json=args.json)


def _print(trials: list[Trial], worst: int, *, as_json: bool) -> None:
    rows = {"all": summary(trials)}
    for low in STRATA_DEG:
        part = [t for t in trials if low <= min(max(t.pitch_deg, 0.0), 89.9) < low + 15]
        if part:
            rows[f"pitch {low}-{low + 15}"] = summary(part)
    out = sys.stdout
    if as_json:
        out.write(json.dumps({"rows": rows, "trials": [asdict(t) for t in trials]}) + "\n")
        return
    for name, row in rows.items():
        out.write(f"{name:12s} " + " ".join(f"{k}={v:.3g}" for k, v in row.items()) + "\n")
    ranked = sorted(trials, key=lambda t: -abs(t.error_deg) if not t.refusal else -99.0)
    for t in ranked[:worst]:
        out.write(
            f"  seed {t.seed} pitch {t.pitch_deg:.0f} err {t.error_deg:.2f} sigma {t.sigma_deg:.2f}"
            f" across {t.across_m:.2f} along {t.along_m:.2f} normal {t.normal_deg:.2f}"
            f" pitch {[None if e is None else round(e, 1) for e in t.pitch_errors_deg]}"
            f" {t.reference} {t.refusal} {t.text}\n"
        )


if __name__ == "__main__":
    main()
