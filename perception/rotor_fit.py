"""Stop angle by one joint fit of the whole rotor: our own method, the default.

Coarse three-arm search (`coarse_rotor`), then hub, axis, angle, cone, prebend, sag, section scales
and each blade's pitch in one robust Gauss-Newton fit to points and edges of the three blades
(`rotor_solver`, `rotor_fit_kernel`), the tower's axis as reference (`tower_reference`), and a
refusal with its reason wherever the cloud does not show three blades 120 deg apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from config.turbine import Turbine
from perception import rotor_fit_kernel as kernel
from perception.blade_section import SectionTable
from perception.coarse_rotor import CoarseRotor, rotor_planes, three_arms
from perception.pitch_starts import best_start, misfits
from perception.rotor import (
    Refusal,
    RefusalCode,
    Rotor,
    angle_of,
    direction_at,
    down_in_plane,
    right_in_plane,
)
from perception.rotor_answer import FitState, rotor_of
from perception.rotor_background import is_background, without_background
from perception.rotor_cloud import about_prior, usable_points
from perception.rotor_edges import BIN_M, BladeData, blade_axes, collect_blades
from perception.rotor_fit_kernel import Prior, Shape
from perception.rotor_prior import parameter_prior, sections_of, station_columns
from perception.rotor_skeleton import straighten
from perception.rotor_solver import RotorSolver
from perception.tower_reference import tower_reference, without_tower
from perception.values import Float

MIN_POINTS = 60
MIN_ARM_M = 1.2
"""Occupied length of each arm in the coarse image: the edge of a feathered blade fills little."""
MIN_SEEN_M = 2.5
"""Of each blade."""
ROUNDS, SETTLING = 3, 7
STILL = 1e-2
"""Metres and radians: collecting the points anew would change nothing."""
FIRST_BIN_M = 2.0
"""Wide bins tell one pitch from another as well as narrow ones, in a third of the time."""


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    """What is fitted: sections and what is known of the parameters."""

    table: SectionTable
    station: Float
    prior: Prior
    sense: float
    known: bool

    @property
    def radius_m(self) -> float:
        return self.table.length_m + self.table.hub_radius_m

    def shape(self, normal: Float, angle: float, down: Float) -> Shape:
        """Return the kernel's view of it, for blades at an angle in a plane."""
        radial, tangential = blade_axes(normal, down, angle)
        right, under = right_in_plane(normal, down), down_in_plane(normal, down)
        axes = np.stack(
            [radial @ right, radial @ under, tangential @ right, tangential @ under], axis=1
        )
        table = self.table
        return Shape(
            np.ascontiguousarray(axes), self.station, table.x, table.y,
            table.length_m, table.hub_radius_m, self.sense,
        )  # fmt: skip


def fit_rotor(
    points_w: Float,
    origins_w: Float,
    *,
    viewpoint_w: Float | None = None,
    prior_hub_w: Float | None = None,
    prior_normal_w: Float | None = None,
    down_w: Float | None = None,
    turbine: Turbine | None = None,
    radius_m: float | None = None,
    stamp_s: float = 0.0,
    prior_sigma_m: float = 8.0,
    use_tower: bool = True,
) -> Rotor | Refusal:
    """Return the rotor seen in a cloud, or why there is none.

    ``points_w``: (N, 3) returns, world ENU, metres; NaN, infinite and zero rows are left out.
    ``origins_w``: (N, 3) or (3,) where the sensor was for each point. ``viewpoint_w``: (3,) the
    middle of them when absent. ``prior_hub_w`` bounds the search to ``prior_sigma_m`` round it;
    ``prior_normal_w``: downwind, within 40 deg. Without it the rotor is taken to face the
    viewpoint only when the tower is seen behind it. ``down_w``: straight down by gravity.
    ``turbine``: its blade shape is used when published; ``radius_m`` otherwise.
    """
    down = np.array([0.0, 0.0, -1.0]) if down_w is None else down_w / np.linalg.norm(down_w)
    points, eye = usable_points(points_w, origins_w, viewpoint_w)
    if len(points) < MIN_POINTS:
        return Refusal(RefusalCode.NO_POINTS, f"{len(points)} usable points, {MIN_POINTS} needed")
    table, published = sections_of(turbine, radius_m)
    radius = table.length_m + table.hub_radius_m
    sense = -1.0 if turbine is not None and turbine.rotation == "counter-clockwise" else 1.0
    prior = parameter_prior(published, turbine, table.length_m)
    model = _Model(table, station_columns(table, published), prior, sense, published)
    about = points
    if prior_hub_w is not None:
        about = about_prior(points, np.asarray(prior_hub_w), prior_normal_w, radius, prior_sigma_m)
    search = _Search(eye, prior_hub_w, prior_normal_w, down, prior_sigma_m)
    seek = partial(_seek, points, search, model, turbine, use_tower=use_tower, stamp_s=stamp_s)
    answer = seek(about)
    if isinstance(answer, Refusal):
        open_air = without_background(about, eye, prior_normal_w, down)
        if len(open_air) < len(about):
            again = seek(open_air)
            return answer if isinstance(again, Refusal) else again
    return answer


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """From where a rotor is looked for, and what is known of it beforehand."""

    eye: Float
    hub_w: Float | None
    normal_w: Float | None
    down: Float
    sigma_m: float


def _seek(
    points: Float,
    search: _Search,
    model: _Model,
    turbine: Turbine | None,
    about: Float,
    *,
    use_tower: bool,
    stamp_s: float,
) -> Rotor | Refusal:
    """Find the rotor coarsely among the points ``about`` the prior, and fit it to all of them."""
    radius, down = model.radius_m, search.down
    coarse = _coarse(about, search, radius)
    if isinstance(coarse, Refusal):
        return coarse
    coarse, cone = straighten(points, coarse, down, radius, search.normal_w)
    state = _fit(points, search.eye, coarse, cone, down, model)
    if isinstance(state, Refusal):
        return state
    tower = (
        tower_reference(points, state.hub_w, state.normal_w, down, radius, turbine)
        if use_tower
        else None
    )
    if search.normal_w is None and tower is None:
        return Refusal(
            RefusalCode.SIDE_UNKNOWN, "no tower seen behind the rotor and no prior axis given"
        )
    return rotor_of(state, tower, down, radius, stamp_s)


def _coarse(points: Float, search: _Search, radius: float) -> CoarseRotor | Refusal:
    down = search.down
    planes = rotor_planes(points, search.eye, search.normal_w, down)
    if not planes:
        return Refusal(RefusalCode.NO_PLANE, "no upright plane with enough points")
    if search.hub_w is None:
        centre, reach = np.median(points, axis=0), 30.0
    else:
        centre, reach = np.asarray(search.hub_w, np.float64), max(search.sigma_m, 3.0)
    found = [three_arms(points, plane, down, centre, reach, radius) for plane in planes]
    usable = [c for c in found if c is not None]
    if not usable:
        return Refusal(RefusalCode.NO_PLANE, "the planes found hold too few points")
    best = max(usable, key=lambda c: c.score)
    if is_background(points, (best.normal_w, float(best.normal_w @ best.hub_w)), down):
        return Refusal(RefusalCode.NOT_A_ROTOR, "what stands out is wider than blades are")
    shortest = min(best.arms_m)
    if shortest < MIN_ARM_M:
        code = RefusalCode.TWO_BLADES if sorted(best.arms_m)[1] > 4.0 else RefusalCode.NOT_A_ROTOR
        return Refusal(code, f"the weakest of three arms is occupied over {shortest:.1f} m")
    return best


def _fit(
    points: Float,
    eye: Float,
    coarse: CoarseRotor,
    cone: float,
    down: Float,
    model: _Model,
) -> FitState | Refusal:
    """Settle the joint fit about a straightened coarse rotor; collect anew where it has moved."""
    hub, normal, angle = coarse.hub_w, coarse.normal_w, coarse.angle_rad
    params = model.prior.mean.copy()
    params[kernel.CONE] = cone
    rivalry = math.inf
    for attempt in range(ROUNDS):
        seen = _look(points, eye, (hub, normal, angle, cone), down, model, first=attempt == 0)
        if isinstance(seen, Refusal):
            return seen
        data = seen
        right, under = right_in_plane(normal, down), down_in_plane(normal, down)
        solver = RotorSolver(data.rows, model.shape(normal, angle, down), model.prior)
        if attempt == 0:
            params, rival = best_start(solver, params)
            rivalry = (rival - solver.cost(params)) / len(data.rows.r_m)
        else:
            params = solver.run(params, SETTLING)
        moved = params.copy()
        hub = hub + moved[kernel.HX] * right + moved[kernel.HY] * under + moved[kernel.HZ] * normal
        first = direction_at(angle + float(moved[kernel.ANGLE]), normal, down)
        normal = normal - moved[kernel.SR] * right - moved[kernel.SD] * under
        normal = normal / np.linalg.norm(normal)
        angle = angle_of(first - (first @ normal) * normal, normal, down)
        cone = float(moved[kernel.CONE])
        if attempt > 0 and np.abs(moved[: kernel.CONE]).max() < STILL:
            break
        params[: kernel.CONE] = 0.0
        if attempt == 0:
            # A blade that hangs before the tower is not to be measured on it.
            tower = tower_reference(points, hub, normal, down, model.radius_m)
            points = points if tower is None else without_tower(points, hub, tower)
    system, _, residuals = solver.last(moved)
    covariance = np.asarray(np.linalg.inv(system), np.float64)
    worst = misfits(solver, residuals)
    return FitState(
        hub, normal, angle, cone, moved, covariance, worst, rivalry, data, residuals, model.known
    )


def _look(
    points: Float,
    eye: Float,
    rotor: tuple[Float, Float, float, float],
    down: Float,
    model: _Model,
    *,
    first: bool,
) -> BladeData | Refusal:
    """Gather what is seen of the blades of a rotor (hub, normal, angle, cone) so far known."""
    hub, normal, angle, cone = rotor
    radius, table = model.radius_m, model.table
    radial, tangential = blade_axes(normal, down, angle)
    data = collect_blades(
        points,
        eye,
        hub,
        (radial, tangential, normal),
        ((0.8 if first else 0.5) + 0.055 * radius, 1.5 + 0.03 * radius, 0.5 + 0.052 * radius),
        (max(1.3, table.hub_radius_m * 1.05 + 0.02 * radius), radius * 1.02),
        -math.tan(cone),
        FIRST_BIN_M if first else BIN_M,
    )
    seen = sorted(data.seen_m)
    if seen[0] >= MIN_SEEN_M:
        return data
    code = RefusalCode.TWO_BLADES if seen[1] >= 4.0 else RefusalCode.LOW_VISIBILITY
    which = int(np.argmin(data.seen_m)) + 1
    return Refusal(code, f"blade {which} is seen over {seen[0]:.1f} m only")
