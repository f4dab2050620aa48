"""The re-centring loop of a flight on drawn turbines: look, estimate, move before the hub, agree.

As the estimate phase flies it: from p_d = p_h - v_n d_c, moved along -v_n until 8 m clear; after a
refusal other distances in turn; at 2 m/s; done when three successive estimates agree. The passive
answer is what the first look alone gives.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from benchmarks.angle_scenes import (
    Approach,
    SceneOptions,
    World,
    build_world,
    clear_place,
    draw_approach,
    look,
)
from benchmarks.angle_trials import Trial, ours
from perception.geometry import stop_angle_difference_deg
from perception.rotor import Rotor
from perception.values import Float

STAND_OFF_M = 20.0
MOVE_MPS = 2.0
SETTLE_S = 1.0
AGREE_DEG, AGREE_COUNT = 0.5, 3
RECENTRE_M, ANEW_M = 0.7, 2.5
MOST_LOOKS = 20
TIMEOUT_S = 90.0
OTHER_DISTANCES = (1.0, 0.8, 1.2)


def fly_estimate(seed: int, options: SceneOptions) -> tuple[Trial, Trial]:
    """Return what the first look gives, and what the loop ends with."""
    rng = np.random.default_rng([seed, 77])
    world = build_world(rng, options, seed)
    approach = draw_approach(world, rng, options)
    return _Loop(seed, world, approach, options, rng).run()


class _Loop:
    def __init__(
        self,
        seed: int,
        world: World,
        approach: Approach,
        options: SceneOptions,
        rng: np.random.Generator,
    ) -> None:
        self._seed, self._world, self._approach = seed, world, approach
        self._options, self._rng = options, rng
        self._good: list[Rotor] = []
        self._refused, self._flown_s = 0, 0.0

    def run(self) -> tuple[Trial, Trial]:
        """Look and move until estimates agree."""
        approach = self._approach
        hub, normal = approach.prior_hub_w, approach.prior_normal_w
        place = clear_place(self._world, hub - normal * approach.stand_off_m, normal)
        trials: list[Trial] = []
        while len(trials) < MOST_LOOKS and self._flown_s < TIMEOUT_S:
            trial, rotor = self._look(place)
            trials.append(trial)
            self._flown_s += self._options.seconds
            share = 1.0
            if rotor is None:
                self._refused += 1
                self._good.clear()
                share = OTHER_DISTANCES[self._refused % len(OTHER_DISTANCES)]
            else:
                self._good.append(rotor)
                hub, normal = rotor.hub_w, rotor.normal_w
            place, moved = self._move(place, hub - normal * STAND_OFF_M * share, normal)
            if not moved and self._agree():
                break
        last = replace(trials[-1], looks=len(trials), phase_s=self._flown_s)
        if not self._agree():
            last = replace(last, error_deg=None, refusal="not_converged: " + last.refusal)
        return trials[0], last

    def _look(self, place: Float) -> tuple[Trial, Rotor | None]:
        scene = look(self._world, self._approach, place, self._rng, self._options)
        answers: list[Rotor] = []
        error_m = self._options.prior_error_m[1]
        trial = ours(self._seed, scene, prior_error_m=error_m, answers=answers)
        return trial, answers[0] if answers else None

    def _move(self, place: Float, goal: Float, normal: Float) -> tuple[Float, bool]:
        goal = clear_place(self._world, goal, normal)
        apart = float(np.linalg.norm(goal - place))
        if apart < RECENTRE_M:
            return place, False
        self._flown_s += apart / MOVE_MPS + SETTLE_S
        if apart > ANEW_M:
            self._good.clear()
        return goal, True

    def _agree(self) -> bool:
        last = [rotor.stop_angle_deg for rotor in self._good[-AGREE_COUNT:]]
        if len(last) < AGREE_COUNT:
            return False
        pairs = itertools.pairwise(last)
        return all(abs(stop_angle_difference_deg(a, b)) < AGREE_DEG for a, b in pairs)
