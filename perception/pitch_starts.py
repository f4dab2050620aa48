"""Which pitches to start the joint fit from, and which of the settled fits to believe.

A section seen from one side has several pitches that look alike at first; settled, the right one
is far cheaper. So: every common pitch is tried with the shape held, the best few are settled in
full, and a blade that fits much worse than its fellows is tried a quarter turn from them.
"""

from __future__ import annotations

import math

import numpy as np

from perception import rotor_fit_kernel as kernel
from perception.rotor_solver import REJECT, RotorSolver
from perception.values import Float

PITCHES = slice(kernel.PITCH, kernel.SPACING)
PITCH_STARTS_DEG = (-4.0, 10.0, 24.0, 38.0, 52.0, 66.0, 80.0, 94.0)
FULL_STARTS = 3
APART_RAD = math.radians(9.0)
HOPELESS = 3.0
"""Times the cheapest start's cost: not worth a full fit."""
RIVAL_RAD = math.radians(25.0)
"""Two pitches this far apart are not two measures of the same one."""
ROWS_OF_A_START = 450
HOPS_RAD = (math.radians(14.0), math.radians(-14.0))
RANGE_RAD = (math.radians(60.0), math.radians(80.0))
"""Middle and half of the pitches that a blade may start at."""
GOOD = 0.5
"""Mean cost a row below which no other pitch need be tried."""
POOR = 0.8
"""Mean cost a row of a blade above which one may stand apart from the others."""


def best_start(solver: RotorSolver, params: Float) -> tuple[Float, float]:
    """Return the cheapest settled fit, and the cost of the best at quite another pitch."""
    settled = [solver.run_cost(guess, 8) for guess in _common_pitches(solver, params)]
    fitted, costs = [guess for guess, _ in settled], [cost for _, cost in settled]
    order = np.argsort(costs)
    best = _with_odd_blade(solver, _hopped(solver, fitted[order[0]], costs[order[0]]))
    cost = solver.cost(best)
    pitch = float(np.median(best[PITCHES]))
    rivals = [
        costs[k]
        for k in order
        if abs(float(np.median(fitted[k][PITCHES])) - pitch) > RIVAL_RAD and costs[k] > cost
    ]
    return best, min(rivals, default=math.inf)


def _common_pitches(solver: RotorSolver, params: Float) -> list[Float]:
    """Return the best few of the common pitches, shape held, pitches bound together."""
    every, held = _thinned(solver), _shape_held()
    tries: list[tuple[float, Float]] = []
    for start in PITCH_STARTS_DEG:
        guess = params.copy()
        guess[PITCHES] = math.radians(start)
        guess, cost = solver.run_cost(guess, 4, held, 12.0, every, bound=True, rigid=True)
        tries.append((cost, guess))
    tries.sort(key=lambda t: t[0])
    chosen: list[Float] = []
    for cost, guess in tries:
        if cost > HOPELESS * tries[0][0]:
            break
        apart = [abs(float((guess - other)[PITCHES].mean())) > APART_RAD for other in chosen]
        if all(apart):
            chosen.append(guess)
    return chosen[:FULL_STARTS]


def _hopped(solver: RotorSolver, params: Float, cost: float) -> Float:
    """Return the cheapest fit within a few hops of pitch.

    What is visible changes with the pitch, and each change leaves a ridge that a step does not
    cross: a hop does.
    """
    best = params
    if cost < GOOD * len(solver.rows.r_m):
        return best
    for hop in HOPS_RAD:
        while True:
            guess = best.copy()
            guess[PITCHES] += hop
            guess, other = solver.run_cost(guess, 7)
            if other > cost - 1.0 or (guess - best)[PITCHES].mean() * hop <= 0.0:
                break
            best, cost = guess, other
    return best


def blade_costs(solver: RotorSolver, residual_m: Float) -> Float:
    """Return each blade's mean robust cost a row (3,), NaN where it has none."""
    z = np.abs(residual_m) / solver.rows.sigma_m
    z = np.where(np.isfinite(z), np.minimum(z, REJECT), REJECT)
    cost = np.where(z < kernel.HUBER, z * z, kernel.HUBER * (2 * z - kernel.HUBER))
    shares = [cost[solver.rows.blade == b] for b in range(3)]
    return np.array([share.mean() if len(share) else math.nan for share in shares])


def misfits(solver: RotorSolver, residual_m: Float) -> Float:
    """Return each blade's 70th percentile of residuals in sigmas (3,).

    Unlike a mean it is blind to the tower behind a blade; a section at a wrong pitch shows in it.
    """
    z = np.abs(residual_m) / solver.rows.sigma_m
    z = np.where(np.isfinite(z), z, REJECT)
    parts = [z[solver.rows.blade == b] for b in range(3)]
    return np.array([_of_rank(part, 0.7) if len(part) else REJECT for part in parts])


def _of_rank(values: Float, share: float) -> float:
    at = int(share * (len(values) - 1))
    return float(np.partition(values, at)[at])


def _with_odd_blade(solver: RotorSolver, params: Float) -> Float:
    """Return the best of the fit and those with one blade a quarter turn from the others.

    Of two blades that stand apart from what was found, one is turned at a time.
    """
    once = _turned(solver, params)
    return once if once is params else _turned(solver, once)


def _turned(solver: RotorSolver, params: Float) -> Float:
    """Return a cheaper fit with one blade, or two, a quarter turn from the fit's common pitch."""
    _, cost, residual = solver.last(params)
    each = np.nan_to_num(blade_costs(solver, residual), nan=0.0)
    if each.max() <= POOR:
        return params
    common = float(np.median(params[PITCHES]))
    every, held = _thinned(solver), _shape_held()
    tries: list[tuple[float, Float]] = []
    for turn in (-math.pi / 2, math.pi / 2):
        # The common pitch found may be that of the two, and the worst blade is odd; or that of
        # the one, which then fits best.
        for turned in (np.eye(3)[each.argmax()], 1.0 - np.eye(3)[each.argmin()]):
            guess = params.copy()
            guess[PITCHES] = common + turn * turned
            if not np.all(np.abs(guess[PITCHES] - RANGE_RAD[0]) < RANGE_RAD[1]):
                continue
            guess[kernel.CHORD :] = solver.prior.mean[kernel.CHORD :]
            guess, other = solver.run_cost(guess, 5, held, 12.0, every, rigid=True)
            tries.append((other, guess))
    tries.sort(key=lambda t: t[0])
    best = params
    for _, start in tries[:2]:
        guess, other = solver.run_cost(start, 10)
        if other < cost:
            best, cost = guess, other
    return best


def _thinned(solver: RotorSolver) -> int:
    return max(1, len(solver.rows.r_m) // ROWS_OF_A_START)


def _shape_held() -> Float:
    held = np.zeros(kernel.PARAMETERS)
    held[kernel.CONE : kernel.PITCH] = 1e6
    held[kernel.SPACING :] = 1e8
    return held
