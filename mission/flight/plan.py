"""The inspection's plan: which legs, in which order and direction, and what cannot be seen.

`plan_steps` works a slice per control tick, because a tick has milliseconds. The order is the
shortest tour found over the ways of the roadmap (greedy from every start, then 2-opt), the way
home round the rotor counted in.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from config.settings import Settings
from config.turbine import Turbine
from mission.flight.around import bearing_rad
from mission.flight.leg import Leg, SidePass
from mission.flight.passes import UPRIGHT, side_steps
from mission.flight.rotor_model import RotorModel
from mission.flight.route import BEYOND_TIPS_M, OUTSIDE_COST, Roadmap, roadmap_steps
from perception.geometry import wrap_angle
from perception.values import Float

WAY_GROUND_MARGIN_M = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """What will be flown."""

    model: RotorModel
    roadmap: Roadmap
    passes: tuple[SidePass, ...]
    legs: tuple[Leg, ...]
    """In the order and direction flown."""


def plan_steps(
    model: RotorModel,
    turbine: Turbine,
    settings: Settings,
    wanted: Sequence[tuple[str, str]],
    from_w: Float,
    ground_m: float,
    lean_w: Float = UPRIGHT,
    home_w: Float | None = None,
) -> Iterator[Plan | None]:
    """Plan the wanted (blade, side) pairs: yields None after each slice and, last, the plan.

    ``home_w``: (3,) where the flight ends; the last leg lies towards it.
    """
    frames = {frame.name: frame for frame in model.frames}
    passes: list[SidePass] = []
    for blade, side in wanted:
        steps = side_steps(frames[blade], side, model, turbine, settings, ground_m, lean_w)
        for side_pass in steps:
            if side_pass is not None:
                passes.append(side_pass)
            yield None
    roadmap: Roadmap | None = None
    for step in roadmap_steps(model, settings.airframe.radius_m, ground_m + WAY_GROUND_MARGIN_M):
        roadmap = step
        yield None
    if roadmap is None:
        raise RuntimeError("the roadmap was not finished")
    legs = [leg for side_pass in passes for leg in side_pass.legs]
    costs: Float | None = None
    for found in _cost_steps(roadmap, legs, from_w):
        costs = found
        yield None
    order = _order(costs, _home_costs(model, legs, home_w)) if costs is not None else []
    flown = tuple(legs[leg] if forward else legs[leg].reversed() for leg, forward in order)
    yield Plan(model, roadmap, tuple(passes), flown)


def plan(
    model: RotorModel,
    turbine: Turbine,
    settings: Settings,
    wanted: Sequence[tuple[str, str]],
    from_w: Float,
    ground_m: float,
) -> Plan:
    """Plan in one go; see `plan_steps`."""
    *_, last = plan_steps(model, turbine, settings, wanted, from_w, ground_m)
    if last is None:
        raise RuntimeError("the plan was not finished")
    return last


def _cost_steps(roadmap: Roadmap, legs: list[Leg], from_w: Float) -> Iterator[Float | None]:
    """Yield None per slice and, last, way lengths between leg ends and from the start.

    (2L + 1, 2L + 1): row 2i is leg i's first photo, 2i + 1 its last, the last row the start.
    """
    if not legs:
        return
    ends = [leg.position(metre) for leg in legs for metre in (leg.photos[0], leg.photos[-1])]
    places = np.stack([*ends, from_w])
    floor = roadmap.clearance_at(places)
    count = len(roadmap.nodes)
    rows, columns, lengths = [roadmap.starts], [roadmap.ends], [roadmap.lengths]
    for index, place in enumerate(places):
        near, apart = roadmap.attach(place, float(floor[index]))
        rows.append(np.full(len(near), count + index))
        columns.append(near)
        lengths.append(apart)
        if index % 4 == 3:
            yield None
    first, second = np.triu_indices(len(places), 1)
    limit = np.minimum(floor[first], floor[second])
    apart = np.linalg.norm(places[first] - places[second], axis=1)
    direct = np.flatnonzero(apart > 1e-6)
    for part in np.array_split(direct, 1 + len(direct) // 60):
        seen = part[roadmap.clear(places[first[part]], places[second[part]], limit[part])]
        rows.append(count + first[seen])
        columns.append(count + second[seen])
        lengths.append(apart[seen])
        yield None
    size = count + len(places)
    graph = csr_matrix(
        (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))),
        shape=(size, size),
    )
    found = []
    for part in np.array_split(np.arange(len(places)), 1 + len(places) // 5):
        found.append(dijkstra(graph, False, count + part)[:, count:])
        yield None
    # A place that no way reaches is left for last rather than never: the flight asks again there.
    yield np.nan_to_num(np.concatenate(found), posinf=1e4)


def _home_costs(model: RotorModel, legs: list[Leg], home_w: Float | None) -> Float:
    """Return (2L,) how far round the rotor the way home leads from each end of each leg.

    In metres of a way near the rotor, which takes longer.
    """
    ends = [leg.position(metre) for leg in legs for metre in (leg.photos[0], leg.photos[-1])]
    if home_w is None:
        return np.zeros(len(ends))
    radius = model.rotor_radius_m + BEYOND_TIPS_M
    home = bearing_rad(model.hub_w, home_w)
    turns = [wrap_angle(bearing_rad(model.hub_w, end) - home) for end in ends]
    return OUTSIDE_COST * radius * np.abs(turns)


def _order(costs: Float, after: Float) -> list[tuple[int, bool]]:
    """Return (leg, flown as planned?) in the order of a short tour that begins at the start.

    ``after``: (2L,) what follows the last leg, by the end at which it ends.
    """
    count = len(after) // 2
    best: list[tuple[int, bool]] = []
    best_m = np.inf
    for first in range(count):
        for forward in (True, False):
            tour = _greedy(costs, count, (first, forward))
            length = _length(costs, after, tour)
            if length < best_m:
                best, best_m = tour, length
    return _two_opt(costs, after, best)


def _entry(leg: tuple[int, bool]) -> int:
    return 2 * leg[0] + (0 if leg[1] else 1)


def _exit(leg: tuple[int, bool]) -> int:
    return 2 * leg[0] + (1 if leg[1] else 0)


def _length(costs: Float, after: Float, tour: list[tuple[int, bool]]) -> float:
    here, total = len(costs) - 1, 0.0
    for leg in tour:
        total += float(costs[here, _entry(leg)])
        here = _exit(leg)
    return total + float(after[here]) if tour else 0.0


def _greedy(costs: Float, count: int, first: tuple[int, bool]) -> list[tuple[int, bool]]:
    tour = [first]
    left = set(range(count)) - {first[0]}
    while left:
        here = _exit(tour[-1])
        step = min(
            ((leg, forward) for leg in sorted(left) for forward in (True, False)),
            key=lambda leg: float(costs[here, _entry(leg)]),
        )
        tour.append(step)
        left.remove(step[0])
    return tour


def _two_opt(costs: Float, after: Float, tour: list[tuple[int, bool]]) -> list[tuple[int, bool]]:
    """Reverse stretches of the tour (and the legs in them) while that shortens it."""
    length = _length(costs, after, tour)
    improved = True
    while improved:
        improved = False
        for i in range(len(tour)):
            for j in range(i, len(tour)):
                turned = [(leg, not forward) for leg, forward in reversed(tour[i : j + 1])]
                other = tour[:i] + turned + tour[j + 1 :]
                other_m = _length(costs, after, other)
                if other_m < length - 1e-6:
                    tour, length, improved = other, other_m, True
    return tour
