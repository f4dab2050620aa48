"""The re-centring loop of a flight on drawn turbines: look, estimate, move before the hub, agree.

As the estimate phase flies it, from p_d = p_h - v_n d_c, moved along -v_n until 8 m clear, at
2 m/s, done when three successive estimates agree. The flight has seen the tower on its way up and
knows the hub to a metre or two; this loop begins with a prior up to 15 m wrong, takes after a
refusal what the same survey of the tower says of the looks so far, and where that says nothing goes
to other places in turn: farther back, higher, lower, to either side, so that a blade out of the
LiDAR's height of view comes into it. The passive answer is what the first look alone gives.
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
from perception.hub_prior import TowerSurvey
from perception.rotor import Rotor, right_in_plane
from perception.values import Float

STAND_OFF_M = 20.0
MOVE_MPS = 2.0
SETTLE_S = 1.0
AGREE_DEG, AGREE_COUNT = 0.5, 3
RECENTRE_M, ANEW_M = 0.7, 2.5
MOST_LOOKS = 20
TIMEOUT_S = 90.0
SURVEY_SIGMA_M = 3.0
OTHER_PLACES = (
    (1.0, 0.0, 0.0), (1.4, 0.0, 0.0), (1.2, 0.0, 8.0), (1.2, 0.0, -8.0), (1.2, 8.0, 0.0),
    (1.2, -8.0, 0.0), (0.8, 0.0, 0.0),
)  # fmt: skip
"""Share of d_c, metres to the right and up."""


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
        foot = approach.prior_hub_w - np.array([0.0, 0.0, world.hub[2]])
        self._survey = TowerSurvey(expected_w=foot, turbine=None)

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
            if rotor is None:
                self._refused += 1
                self._good.clear()
                surveyed = self._surveyed()
                if surveyed is not None:
                    hub, normal = surveyed
                    goal = hub - normal * STAND_OFF_M
                if surveyed is None or float(np.linalg.norm(goal - place)) < RECENTRE_M:
                    goal = _other_place(self._refused, hub, normal)
            else:
                self._good.append(rotor)
                hub, normal = rotor.hub_w, rotor.normal_w
                goal = hub - normal * STAND_OFF_M
            place, moved = self._move(place, goal, normal)
            if not moved and self._agree():
                break
        last = replace(trials[-1], looks=len(trials), phase_s=self._flown_s)
        if not self._agree():
            last = replace(last, error_deg=None, refusal="not_converged: " + last.refusal)
        return trials[0], last

    def _look(self, place: Float) -> tuple[Trial, Rotor | None]:
        scene = look(self._world, self._approach, place, self._rng, self._options)
        self._survey.update(scene.points_w, self._flown_s)
        answers: list[Rotor] = []
        error_m = self._options.prior_error_m[1]
        trial = ours(self._seed, scene, prior_error_m=error_m, answers=answers)
        return trial, answers[0] if answers else None

    def _surveyed(self) -> tuple[Float, Float] | None:
        """Return hub and axis as the tower and what stands off it tell them, by all looks."""
        found = self._survey.result()
        if found is None or found.normal_w is None or found.sigma_m > SURVEY_SIGMA_M:
            return None
        return found.hub_w, found.normal_w

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


def _other_place(refused: int, hub: Float, normal: Float) -> Float:
    """Return where to look from after so many refusals: (3,)."""
    share, right_m, up_m = OTHER_PLACES[refused % len(OTHER_PLACES)]
    down = np.array([0.0, 0.0, -1.0])
    right = right_in_plane(normal, down)
    return np.asarray(hub - normal * STAND_OFF_M * share + right_m * right - up_m * down)
