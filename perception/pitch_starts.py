"""Starts of the fit: the pitches worth a full fit, and blades that stand apart."""

from __future__ import annotations

import math

import numpy as np

from perception import rotor_fit_kernel as kernel
from perception.rotor_edges import BladeData
from perception.rotor_solver import RotorSolver
from perception.values import Float

RUNNER_UP = 2.0
"""A second start is fitted in full where its cost is below this many times the first's."""
PITCH_STARTS_DEG = (-3.0, 12.0, 28.0, 45.0, 62.0, 78.0, 92.0)


def start_pitches(solver: RotorSolver, params: Float, data: BladeData) -> list[Float]:
    """Return the starts worth fitting in full: the best common pitch and a different runner-up."""
    every = max(1, len(data.rows.r_m) // 500)
    held = np.zeros(kernel.PARAMETERS)
    held[kernel.CONE : kernel.PITCH] = 1e8
    held[kernel.SPACING :] = 1e8
    tries: list[tuple[float, Float]] = []
    for start in PITCH_STARTS_DEG:
        guess = params.copy()
        guess[kernel.PITCH : kernel.SPACING] = math.radians(start)
        guess = solver.run(guess, 5, held, 12.0, every)
        tries.append((solver.cost(guess, 12.0, every), guess))
    tries.sort(key=lambda t: t[0])
    best = tries[0][1]
    pitches = slice(kernel.PITCH, kernel.SPACING)
    others = [
        guess
        for cost, guess in tries[1:]
        if abs(float(np.median(guess[pitches]) - np.median(best[pitches]))) > math.radians(10)
        and cost < RUNNER_UP * tries[0][0]
    ]
    # A blade may stand apart from the other two.
    for b in range(3):
        options = [best]
        for start in (0.0, 45.0, 88.0):
            if abs(math.degrees(best[kernel.PITCH + b]) - start) > 25:
                guess = best.copy()
                guess[kernel.PITCH + b] = math.radians(start)
                options.append(solver.run(guess, 4, held, 12.0, every))
        best = min(options, key=lambda g: solver.cost(g, 12.0, every))
    return [best, *others[:1]]


def regroup(solver: RotorSolver, params: Float) -> Float:
    """Return the better of the fit and those with one blade's pitch put to the other two's."""
    best, best_cost = params, solver.cost(params)
    for b in range(3):
        others = [kernel.PITCH + (b + 1) % 3, kernel.PITCH + (b + 2) % 3]
        target = float(params[others].mean())
        if abs(params[kernel.PITCH + b] - target) < math.radians(8):
            continue
        guess = params.copy()
        guess[kernel.PITCH + b] = target
        guess = solver.run(guess, 12)
        cost = solver.cost(guess)
        if cost < best_cost:
            best, best_cost = guess, cost
    return best
