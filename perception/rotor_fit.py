"""Stop angle by one joint fit of the whole rotor: our own method, the default.

Coarse three-arm search (`coarse_rotor`), then hub, axis, angle, cone, prebend, sag, section scales
and each blade's pitch in one robust Gauss-Newton fit to points and edges of the three blades
(`rotor_solver`, `rotor_fit_kernel`), the tower's axis as reference (`tower_reference`), and a
refusal with its reason wherever the cloud does not show three blades 120 deg apart.
"""

from __future__ import annotations

import math

import numpy as np

from config.turbine import Turbine
from perception import rotor_fit_kernel as kernel
from perception.blade_section import SectionTable
from perception.coarse_rotor import CoarseRotor, rotor_planes, three_arms
from perception.pitch_starts import best_start
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
from perception.rotor_cloud import about_prior, usable_points
from perception.rotor_edges import blade_axes, collect_blades
from perception.rotor_fit_kernel import Shape
from perception.rotor_prior import parameter_prior, sections_of, station_columns
from perception.rotor_skeleton import straighten
from perception.rotor_solver import RotorSolver
from perception.tower_reference import tower_reference
from perception.values import Float

MIN_POINTS = 60


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
    coarse = _coarse(points, eye, prior_hub_w, prior_normal_w, down, radius, prior_sigma_m)
    if isinstance(coarse, Refusal):
        return coarse
    sense = -1.0 if turbine is not None and turbine.rotation == "counter-clockwise" else 1.0
    coarse, cone = straighten(points, coarse, down, radius, prior_normal_w)
    state = _fit(points, eye, coarse, cone, down, table, published, turbine, sense)
    if isinstance(state, Refusal):
        return state
    tower = (
        tower_reference(points, state.hub_w, state.normal_w, down, radius) if use_tower else None
    )
    if prior_normal_w is None and tower is None:
        return Refusal(
            RefusalCode.SIDE_UNKNOWN, "no tower seen behind the rotor and no prior axis given"
        )
    return rotor_of(state, tower, down, radius, stamp_s)


def _coarse(
    points: Float,
    eye: Float,
    prior_hub_w: Float | None,
    prior_normal_w: Float | None,
    down: Float,
    radius: float,
    prior_sigma_m: float,
) -> CoarseRotor | Refusal:
    if prior_hub_w is not None:
        points = about_prior(points, np.asarray(prior_hub_w), prior_normal_w, radius, prior_sigma_m)
    planes = rotor_planes(points, eye, prior_normal_w, down)
    if not planes:
        return Refusal(RefusalCode.NO_PLANE, "no upright plane with enough points")
    if prior_hub_w is None:
        centre, reach = np.median(points, axis=0), 30.0
    else:
        centre, reach = np.asarray(prior_hub_w, np.float64), max(prior_sigma_m, 3.0)
    found = [three_arms(points, plane, down, centre, reach, radius) for plane in planes]
    usable = [c for c in found if c is not None]
    if not usable:
        return Refusal(RefusalCode.NO_PLANE, "the planes found hold too few points")
    best = max(usable, key=lambda c: c.score)
    shortest = min(best.arms_m)
    if shortest < 2.0:
        code = RefusalCode.TWO_BLADES if sorted(best.arms_m)[1] > 4.0 else RefusalCode.NOT_A_ROTOR
        return Refusal(code, f"the weakest of three arms is occupied over {shortest:.1f} m")
    return best


def _fit(
    points: Float,
    eye: Float,
    coarse: CoarseRotor,
    cone: float,
    down: Float,
    table: SectionTable,
    published: bool,
    turbine: Turbine | None,
    sense: float,
) -> FitState | Refusal:
    radius = table.length_m + table.hub_radius_m
    station = station_columns(table, published)
    prior = parameter_prior(published, turbine, table.length_m)
    params = prior.mean.copy()
    params[kernel.CONE] = cone
    hub, normal, angle = coarse.hub_w, coarse.normal_w, coarse.angle_rad
    depth_slope: float | None = -math.tan(cone)
    rounds = 3
    result: FitState | Refusal = Refusal(RefusalCode.NOT_CONVERGED, "the fit did not settle")
    for attempt in range(rounds):
        radial, tangential = blade_axes(normal, down, angle)
        wide = 0.8 + 0.055 * radius if attempt == 0 else 0.5 + 0.055 * radius
        gate = (wide, 1.5 + 0.03 * radius, 0.5 + 0.052 * radius)
        data = collect_blades(
            points,
            eye,
            hub,
            (radial, tangential, normal),
            gate,
            (max(1.3, table.hub_radius_m * 1.05 + 0.02 * radius), radius * 1.02),
            depth_slope,
        )
        if min(data.counts) < 5:
            few = int(np.argmin(data.counts))
            return Refusal(
                RefusalCode.TWO_BLADES
                if sorted(data.counts)[1] >= 8
                else RefusalCode.LOW_VISIBILITY,
                f"blade {few + 1} is seen over {data.counts[few] * 0.5:.1f} m only",
            )
        right, under = right_in_plane(normal, down), down_in_plane(normal, down)
        axes = np.stack(
            [radial @ right, radial @ under, tangential @ right, tangential @ under], axis=1
        )
        shape = Shape(
            np.ascontiguousarray(axes), station, table.x, table.y,
            table.length_m, table.hub_radius_m, sense,
        )  # fmt: skip
        solver = RotorSolver(data.rows, shape, prior)
        if attempt == 0:
            params, _ = best_start(solver, params)
        else:
            params = solver.run(params, 10)
        jtj, cost, residuals = solver.last(params)
        hub = (
            hub + params[kernel.HX] * right + params[kernel.HY] * under + params[kernel.HZ] * normal
        )
        slope_r, slope_d = float(params[kernel.SR]), float(params[kernel.SD])
        old = direction_at(angle + float(params[kernel.ANGLE]), normal, down)
        normal = normal - slope_r * right - slope_d * under
        normal = normal / np.linalg.norm(normal)
        angle = angle_of(old - (old @ normal) * normal, normal, down)
        cone = float(params[kernel.CONE])
        result = FitState(
            hub,
            normal,
            angle,
            cone,
            params.copy(),
            np.asarray(np.linalg.inv(jtj), np.float64),
            cost,
            data,
            residuals,
        )
        depth_slope = -math.tan(cone)
        params[: kernel.CONE] = 0.0
    return result
