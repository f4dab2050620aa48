"""Stop angle by one joint fit of the whole rotor: our own method, the default.

Coarse three-arm search (`coarse_rotor`), then hub, axis, angle, cone, prebend, sag, section scales
and each blade's pitch in one robust Gauss-Newton fit to points and edges of the three blades
(`rotor_fit_kernel`), the tower's axis as reference (`tower_reference`), and a refusal with its
reason wherever the cloud does not show three blades 120 deg apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from config.turbine import Turbine
from perception import rotor_fit_kernel as kernel
from perception.blade_section import SectionTable, generic_sections, published_sections
from perception.coarse_rotor import CoarseRotor, rotor_planes, three_arms
from perception.rotor import (
    Blade,
    Refusal,
    RefusalCode,
    Rotor,
    angle_of,
    blade_angles_deg,
    direction_at,
    down_in_plane,
    right_in_plane,
)
from perception.rotor_edges import BladeData, blade_axes, collect_blades
from perception.tower_reference import TowerReference, tower_reference
from perception.values import Float

MAX_POINTS = 60_000
MIN_POINTS = 60
MIN_RANGE_M = 6.0
"""Nearer returns are clutter: the vehicle keeps further away than this."""
PITCH_SPREAD_RAD = math.radians(1.3)
"""Blades of one rotor rarely stand further apart; beyond three times this they are let go."""
MAX_SPREAD_DEG = 9.0
MAX_PITCH_SIGMA_DEG = 9.0
MIN_TILT_DEG, MAX_TILT_DEG = -5.0, 13.0
RUNNER_UP = 2.0
"""A second start is fitted in full where its cost is below this many times the first's."""
APART_COST = 25.0
APART_RAD = math.radians(20.0)
PITCH_STARTS_DEG = (-3.0, 12.0, 28.0, 45.0, 62.0, 78.0, 92.0)
#: Standard deviations of chord, pitch axis, thickness and twist: common to the span, and free along
#: it. The free ones are the spread of the published blades about the generic one.
FREE_SHAPE = ((0.07, 0.09), (0.02, 0.03), (0.08, 0.15), (math.radians(1.0), math.radians(2.5)))
KNOWN_SHAPE = ((0.02, 0.01), (0.015, 0.01), (0.02, 0.03), (math.radians(0.4), math.radians(0.3)))
PITCH_RANGE_DEG = (-14.0, 112.0)
DEFAULT_RADIUS_M = 50.0
HUBER, REJECT = 1.5, 7.0
SIGMA_FACTOR = 1.8
"""Error over formal error of the fit, on the tuning scenes."""
FLOOR_DEG = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    hub_w: Float
    normal_w: Float
    angle_rad: float
    cone_rad: float
    params: Float
    covariance: Float
    cost: float
    data: BladeData
    residuals: Float


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
    points, eye = _clean(points_w, origins_w, viewpoint_w)
    if len(points) < MIN_POINTS:
        return Refusal(RefusalCode.NO_POINTS, f"{len(points)} usable points, {MIN_POINTS} needed")
    table, published = _sections(turbine, radius_m)
    radius = table.length_m + table.hub_radius_m
    coarse = _coarse(points, eye, prior_hub_w, prior_normal_w, down, radius, prior_sigma_m)
    if isinstance(coarse, Refusal):
        return coarse
    sense = -1.0 if turbine is not None and turbine.rotation == "counter-clockwise" else 1.0
    state = _fit(points, eye, coarse, down, table, published, turbine, sense)
    if isinstance(state, Refusal):
        return state
    tower = (
        tower_reference(points, state.hub_w, state.normal_w, down, radius) if use_tower else None
    )
    if prior_normal_w is None and tower is None:
        return Refusal(
            RefusalCode.SIDE_UNKNOWN, "no tower seen behind the rotor and no prior axis given"
        )
    return _rotor(state, tower, down, radius, stamp_s)


def _clean(points_w: Float, origins_w: Float, viewpoint_w: Float | None) -> tuple[Float, Float]:
    """Return finite, thinned points (M, 3) and the viewpoint (3,)."""
    points: Float = np.asarray(points_w, np.float64).reshape(-1, 3)
    origins = np.asarray(origins_w, np.float64)
    if origins.ndim == 2 and len(origins) != len(points):
        raise ValueError("origins_w must be (3,) or as long as points_w")
    if len(points) > MAX_POINTS:
        step = -(-len(points) // MAX_POINTS)
        points = points[::step]
        origins = origins[::step] if origins.ndim == 2 else origins
    finite = np.isfinite(points).all(axis=1) & (np.abs(points) < 1e5).all(axis=1)
    finite &= (points != 0).any(axis=1)
    points = points[finite]
    if origins.ndim == 2:
        origins = origins[finite]
        sane = origins[np.isfinite(origins).all(axis=1)]
        middle = np.median(sane, axis=0) if len(sane) else np.zeros(3)
    else:
        middle = origins
    eye = middle if viewpoint_w is None else np.asarray(viewpoint_w, np.float64)
    ranges = np.linalg.norm(points - eye, axis=1)
    return points[(ranges > MIN_RANGE_M) & (ranges < 120.0)], eye


def _sections(turbine: Turbine | None, radius_m: float | None) -> tuple[SectionTable, bool]:
    if turbine is not None and turbine.shape == "published":
        return published_sections(turbine), True
    if radius_m is None:
        radius_m = turbine.rotor_radius_m if turbine is not None else DEFAULT_RADIUS_M
    return generic_sections(radius_m), False


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
        points = _about_prior(
            points, np.asarray(prior_hub_w), prior_normal_w, radius, prior_sigma_m
        )
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


def _about_prior(
    points: Float, hub_w: Float, normal_w: Float | None, radius: float, prior_sigma_m: float
) -> Float:
    """Leave out what cannot be this rotor: hills, neighbours, the ground beneath."""
    rel = points - hub_w
    keep = np.linalg.norm(rel, axis=1) < radius + prior_sigma_m
    if normal_w is not None:
        # A prior axis 10 deg wrong moves a blade's depth by a sixth of the radius seen.
        keep &= np.abs(rel @ normal_w) < prior_sigma_m + 0.2 * radius
    return np.asarray(points[keep], np.float64)


def _fit(
    points: Float,
    eye: Float,
    coarse: CoarseRotor,
    down: Float,
    table: SectionTable,
    published: bool,
    turbine: Turbine | None,
    sense: float,
) -> _State | Refusal:
    radius = table.length_m + table.hub_radius_m
    station = _stations(table)
    prior_mean, prior_info = _prior(published, turbine, radius)
    params = prior_mean.copy()
    hub, normal, angle = coarse.hub_w, coarse.normal_w, coarse.angle_rad
    lines: Float | None = None
    rounds = 3
    result: _State | Refusal = Refusal(RefusalCode.NOT_CONVERGED, "the fit did not settle")
    for attempt in range(rounds):
        radial, tangential = blade_axes(normal, down, angle)
        wide = 1.2 + 0.045 * radius if attempt == 0 else 0.5 + 0.055 * radius
        gate = (wide, 1.5 + 0.03 * radius, 0.5 + 0.052 * radius)
        data = collect_blades(
            points,
            eye,
            hub,
            (radial, tangential, normal),
            gate,
            (max(1.3, table.hub_radius_m * 1.05 + 0.02 * radius), radius * 1.02),
            lines,
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
        solver = _Solver(data, axes, station, table, sense, prior_mean, prior_info)
        if attempt == 0:
            fitted = [solver.run(start, 10) for start in _start_pitches(solver, params, data)]
            params = _regroup(solver, min(fitted, key=solver.cost))
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
        result = _State(
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
        lines = np.array([[-math.tan(cone), 0.0]] * 3)
        params[: kernel.CONE] = 0.0
    return result


def _stations(table: SectionTable) -> Float:
    s = np.linspace(0.0, 1.0, len(table.chord_m))
    bend = s**2 * (6 - 4 * s + s**2) / 3  # a cantilever under an even load, 1 at the tip
    return np.stack(
        [table.chord_m, table.twist_rad, table.pitch_axis, table.prebend_m, bend], axis=1
    )


def _prior(published: bool, turbine: Turbine | None, radius: float) -> tuple[Float, Float]:
    """Return the mean (P,) and information matrix (P, P) of the parameters."""
    k = kernel
    mean, sigma = np.zeros(k.PARAMETERS), np.full(k.PARAMETERS, 1e3)
    mean[k.PREBEND] = 1.0
    mean[k.CONE] = math.radians(turbine.cone_deg if published and turbine else 2.5)
    sigma[k.CONE] = math.radians(0.5 if published else 2.0)
    mean[k.SAG] = 0.0175 * radius * radius / 65.0
    sigma[k.SAG] = 0.35 * mean[k.SAG]
    sigma[k.PREBEND] = 0.05 if published else 0.6
    mean[k.PITCH : k.CHORD], sigma[k.PITCH : k.CHORD] = math.radians(45), math.radians(120)
    info = np.diag(1.0 / sigma**2)
    for first, (together, apart) in zip(
        (k.CHORD, k.AXIS, k.THICK, k.TWIST), KNOWN_SHAPE if published else FREE_SHAPE, strict=True
    ):
        gap = np.abs(np.subtract.outer(k.KNOT_SPAN, k.KNOT_SPAN)) / 0.12
        spread = together**2 + apart**2 * np.exp(-gap) + np.eye(k.KNOTS) * (0.05 * apart) ** 2
        if first in (k.AXIS, k.THICK):  # the root is a circle on its axis
            calm = np.ones(k.KNOTS)
            calm[0] = 0.15
            spread = spread * np.outer(calm, calm)
        block = slice(first, first + k.KNOTS)
        info[block, block] = np.linalg.inv(spread)
    return mean, info


class _Solver:
    """Gauss-Newton with priors on one set of rows."""

    def __init__(
        self,
        data: BladeData,
        axes: Float,
        station: Float,
        table: SectionTable,
        sense: float,
        prior_mean: Float,
        prior_info: Float,
    ) -> None:
        self._rows = (
            data.blade,
            data.r_m,
            data.v_m,
            data.w_m,
            data.kind,
            np.ascontiguousarray(data.view),
            data.sigma_m,
        )
        self._shape = (
            np.ascontiguousarray(axes),
            station,
            table.x,
            table.y,
            table.length_m,
            table.hub_radius_m,
            sense,
        )
        self._mean, self._info = prior_mean, prior_info
        self._jtj = np.zeros((kernel.PARAMETERS, kernel.PARAMETERS))
        self._jtr = np.zeros(kernel.PARAMETERS)
        self._residual = np.zeros(len(data.r_m))
        self._data = data

    def cost(self, params: Float, reject: float = REJECT, every: int = 1) -> float:
        rows = (
            tuple(np.ascontiguousarray(c[::every]) for c in self._rows) if every > 1 else self._rows
        )
        value = kernel.normal_equations(
            params,
            *rows,
            *self._shape,
            HUBER,
            reject,
            self._jtj,
            self._jtr,
            self._residual[: len(rows[1])],
        )
        off = params - self._mean
        return float(value) + float(off @ self._info @ off) + self._couple(params)

    def _couple(self, params: Float) -> float:
        """Add what binds the pitches to each other; return its share of the cost."""
        cost = 0.0
        info = 1.0 / PITCH_SPREAD_RAD**2
        for a, b in ((0, 1), (1, 2), (2, 0)):
            i, j = kernel.PITCH + a, kernel.PITCH + b
            gap = float(params[i] - params[j])
            part = gap * gap * info / 3.0
            if abs(gap) > APART_RAD:
                cost += APART_COST
                continue
            cost += min(part, APART_COST)
            self._jtj[i, i] += info / 3.0
            self._jtj[j, j] += info / 3.0
            self._jtj[i, j] -= info / 3.0
            self._jtj[j, i] -= info / 3.0
            self._jtr[i] -= gap * info / 3.0
            self._jtr[j] += gap * info / 3.0
        return cost

    def run(
        self,
        params: Float,
        iterations: int,
        held: Float | None = None,
        reject: float = REJECT,
        every: int = 1,
    ) -> Float:
        """Iterate; ``held`` is an additional stiffness per parameter (large: not moved)."""
        stiff = np.zeros(kernel.PARAMETERS) if held is None else held
        params = params.copy()
        for _ in range(iterations):
            self.cost(params, reject, every)
            system = self._jtj + self._info + np.diag(stiff + 1e-9)
            step = np.linalg.solve(system, self._jtr - self._info @ (params - self._mean))
            limit = np.full(kernel.PARAMETERS, 0.3)
            limit[: kernel.SR] = 1.0
            limit[kernel.SAG] = 1.0
            step = np.clip(step, -limit, limit)
            params += step
            params[kernel.CHORD : kernel.AXIS] = np.clip(
                params[kernel.CHORD : kernel.AXIS], -0.4, 0.5
            )
            params[kernel.THICK : kernel.TWIST] = np.clip(
                params[kernel.THICK : kernel.TWIST], -0.5, 0.7
            )
            if (
                np.abs(step[: kernel.PREBEND]).max() < 1e-4
                and np.abs(step[kernel.PITCH : kernel.CHORD]).max() < 2e-3
            ):
                break
        return params

    def last(self, params: Float) -> tuple[Float, float, Float]:
        cost = self.cost(params)
        return (
            self._jtj + self._info + np.eye(kernel.PARAMETERS) * 1e-9,
            cost,
            self._residual.copy(),
        )


def _start_pitches(solver: _Solver, params: Float, data: BladeData) -> list[Float]:
    """Return the starts worth fitting in full: the best common pitch and a different runner-up."""
    every = max(1, len(data.r_m) // 500)
    held = np.zeros(kernel.PARAMETERS)
    held[kernel.CONE : kernel.PITCH] = 1e8
    held[kernel.CHORD :] = 1e8
    tries: list[tuple[float, Float]] = []
    for start in PITCH_STARTS_DEG:
        guess = params.copy()
        guess[kernel.PITCH : kernel.CHORD] = math.radians(start)
        guess = solver.run(guess, 5, held, 12.0, every)
        tries.append((solver.cost(guess, 12.0, every), guess))
    tries.sort(key=lambda t: t[0])
    best = tries[0][1]
    pitches = slice(kernel.PITCH, kernel.CHORD)
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


def _pitch(state: _State, b: int) -> tuple[float | None, float]:
    """Return a blade's pitch and its sigma, degrees; None rather than a doubtful one.

    Leading and trailing edge are told apart by the sense of rotation and the range that pitch can
    have. A blade may be alike the others or a quarter turn from them: between, the fit is stuck.
    """
    pitches = np.degrees(state.params[kernel.PITCH : kernel.CHORD])
    pitch = float(pitches[b])
    variance = float(state.covariance[kernel.PITCH + b, kernel.PITCH + b])
    sigma = SIGMA_FACTOR * math.degrees(math.sqrt(variance))
    apart = abs(pitch - float(np.median(pitches)))
    alike = apart < MAX_SPREAD_DEG or abs(apart - 90.0) < 2 * MAX_SPREAD_DEG
    inside = PITCH_RANGE_DEG[0] < pitch < PITCH_RANGE_DEG[1]
    return (pitch if inside and alike and sigma < MAX_PITCH_SIGMA_DEG else None), sigma


def _regroup(solver: _Solver, params: Float) -> Float:
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


def _rotor(
    state: _State, tower: TowerReference | None, down: Float, radius: float, stamp_s: float
) -> Rotor | Refusal:
    residual = state.residuals[np.isfinite(state.residuals)]
    close = float((np.abs(residual) < 0.35).mean()) if len(residual) else 0.0
    if close < 0.6:
        return Refusal(
            RefusalCode.NOT_A_ROTOR, f"only {close:.0%} of the points lie on the fitted blades"
        )
    tilt = math.degrees(math.asin(float(state.normal_w @ down)))
    if not MIN_TILT_DEG < tilt < MAX_TILT_DEG:
        return Refusal(RefusalCode.NOT_A_ROTOR, f"a shaft does not tilt by {tilt:.0f} deg")
    reference_down = down if tower is None else tower.down_w
    first = angle_of(
        direction_at(state.angle_rad, state.normal_w, down), state.normal_w, reference_down
    )
    stop = math.degrees(first) % 120.0
    variance = float(state.covariance[kernel.ANGLE, kernel.ANGLE])
    reference_sigma = math.radians(0.5) if tower is None else tower.sigma_rad
    sigma = math.degrees(math.sqrt(variance * SIGMA_FACTOR**2 + reference_sigma**2))
    names = blade_angles_deg(stop)
    turn = round(((names[0] - math.degrees(first)) % 360.0) / 120.0) % 3
    blades = []
    for i, name in enumerate("ABC"):
        b = (turn + i) % 3
        pitch, pitch_sigma = _pitch(state, b)
        known = pitch is not None
        direction = direction_at(
            state.angle_rad + 2 * math.pi / 3 * b, state.normal_w, down, state.cone_rad
        )
        tip = state.data.reach_m[b]
        blades.append(
            Blade(
                name,
                direction,
                pitch,
                pitch_sigma if known else None,
                tip if tip > 0.93 * radius else None,
            )
        )
    return Rotor(
        stamp_s,
        state.hub_w,
        state.normal_w,
        stop,
        max(sigma, FLOOR_DEG),
        "gravity" if tower is None else "tower",
        (blades[0], blades[1], blades[2]),
        "rotor_fit",
        math.degrees(state.cone_rad),
        len(state.data.r_m),
    )
