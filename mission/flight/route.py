"""Ways round the rotor: a roadmap of collision-checked segments and the shortest way through it.

Nodes lie on cylinders round the rotor's axis: before and behind the disc, in the sectors between
the blades, and beyond the tips. A segment is admitted when it stays ``CLEARANCE_M`` from the model
(from the airframe's outermost point), so front and back are joined only outside the rotor or
through sectors wide enough.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from mission.flight.rotor_model import RotorModel
from perception.values import Float

CLEARANCE_M = 9.5
SAMPLE_M = 2.0
AZIMUTHS = 24
#: Axial stations behind (+) and before (-) the rotor plane.
AXIAL_M = (-24.0, -15.0, 0.0, 15.0, 26.0)
#: Beyond the tips, outside the sphere that is closed until the rotor is known.
BEYOND_TIPS_M = 13.5
ATTACH = 14
#: A metre outside takes so much of the time of one near the rotor (2 m/s here, 5 m/s there).
OUTSIDE_COST = 0.4


@dataclass(frozen=True, slots=True, eq=False)
class Roadmap:
    """Nodes (N, 3) and the lengths of the segments between them."""

    model: RotorModel
    airframe_radius_m: float
    ground_m: float
    nodes: Float
    outside: NDArray[np.bool_]
    """(N,) nodes beyond the tips: the way out ends there."""
    starts: NDArray[np.intp]
    ends: NDArray[np.intp]
    lengths: Float

    def clear(self, starts: Float, ends: Float, clearance_m: Float) -> NDArray[np.bool_]:
        """Return which straight segments (K, 3) -> (K, 3) keep their clearance (K,)."""
        lengths = np.linalg.norm(ends - starts, axis=1)
        count = max(2, math.ceil(float(lengths.max(initial=0.0)) / SAMPLE_M) + 1)
        share = np.linspace(0.0, 1.0, count)
        points = starts[:, None, :] + share[None, :, None] * (ends - starts)[:, None, :]
        distance = self.model.distance(points.reshape(-1, 3)) - self.airframe_radius_m
        clear: NDArray[np.bool_] = distance.reshape(len(starts), count).min(axis=1) >= clearance_m
        above: NDArray[np.bool_] = points[:, :, 2].min(axis=1) >= self.ground_m
        return clear & above

    def clearance_at(self, points: Float) -> Float:
        """Return the clearance (K,) that a way may have at its end: never more than is there."""
        here = self.model.distance(points) - self.airframe_radius_m - 0.05
        return np.minimum(CLEARANCE_M, here)

    def way(self, from_w: Float, to_w: Float) -> Float | None:
        """Return the polyline (K, 3) of the shortest clear way, or None."""
        floor = self.clearance_at(np.stack([from_w, to_w]))
        if self.clear(from_w[None], to_w[None], floor.min()[None])[0]:
            return np.stack([from_w, to_w])
        return self._through(from_w, to_w[None], floor)

    def way_out(self, from_w: Float, bound_for_w: Float | None = None) -> Float | None:
        """Return the polyline of a clear way to a node beyond the tips, or None.

        The shortest; with ``bound_for_w`` (3,) the one by which that place is reached soonest.
        """
        exits = np.flatnonzero(self.outside)
        if not len(exits):
            return None
        floor = self.clearance_at(from_w[None])
        beyond = np.zeros(len(exits))
        if bound_for_w is not None:
            beyond = OUTSIDE_COST * np.linalg.norm(self.nodes[exits] - bound_for_w, axis=1)
        return self._through(from_w, None, np.array([floor[0], CLEARANCE_M]), exits, beyond)

    def _through(
        self,
        from_w: Float,
        to_w: Float | None,
        floor: Float,
        exits: NDArray[np.intp] | None = None,
        beyond: Float | None = None,
    ) -> Float | None:
        count = len(self.nodes)
        target = from_w if to_w is None else to_w[0]
        begin, begin_m = self.attach(from_w, float(floor[0]))
        rows = [self.starts, np.full(len(begin), count)]
        columns = [self.ends, begin]
        lengths = [self.lengths, begin_m]
        if to_w is not None:
            end, end_m = self.attach(to_w[0], float(floor[1]))
            rows.append(np.full(len(end), count + 1))
            columns.append(end)
            lengths.append(end_m)
        graph = csr_matrix(
            (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))),
            shape=(count + 2, count + 2),
        )
        found, paths = dijkstra(
            graph, directed=False, indices=np.array([count]), return_predecessors=True
        )
        distance, before = found[0], paths[0]
        goal = count + 1
        if exits is not None and beyond is not None:
            goal = int(exits[(distance[exits] + beyond).argmin()])
        if not np.isfinite(distance[goal]):
            return None
        chain = [goal]
        while chain[-1] != count:
            chain.append(int(before[chain[-1]]))
        ends = {count: from_w, count + 1: target}
        places = [ends[i] if i in ends else self.nodes[i] for i in reversed(chain)]
        return self._shortened(np.stack(places), floor)

    def attach(self, point_w: Float, floor_m: float) -> tuple[NDArray[np.intp], Float]:
        """Return the nodes that a point sees, and their distances, nearest first."""
        apart = np.linalg.norm(self.nodes - point_w, axis=1)
        near = np.argsort(apart)[: 3 * ATTACH]
        starts = np.repeat(point_w[None], len(near), axis=0)
        clear = self.clear(starts, self.nodes[near], np.full(len(near), floor_m))
        seen = near[clear][:ATTACH]
        return seen, np.maximum(apart[seen], 1e-6)

    def _shortened(self, way: Float, floor: Float) -> Float:
        """Cut corners where the straight segment is clear as well."""
        kept = [0]
        last = len(way) - 1
        while kept[-1] < last:
            here = kept[-1]
            later = np.arange(here + 1, last + 1)
            limit = np.full(len(later), CLEARANCE_M)
            if here == 0:
                limit = np.minimum(limit, floor[0])
            limit[-1] = min(limit[-1], floor[1])
            clear = self.clear(np.repeat(way[here][None], len(later), axis=0), way[later], limit)
            clear[0] = True
            kept.append(int(later[np.flatnonzero(clear)[-1]]))
        return way[kept]


def roadmap_steps(
    model: RotorModel, airframe_radius_m: float, ground_m: float, slices: int = 8
) -> Iterator[Roadmap | None]:
    """Build the roadmap a slice at a time: yields None until, last, the roadmap."""
    radii = np.array([5.0, 0.4, 0.75, 1.0]) * np.array([1.0, *[model.rotor_radius_m] * 3])
    radii[3] += BEYOND_TIPS_M
    nodes, grid = _nodes(model, radii)
    clear = (model.distance(nodes) - airframe_radius_m >= CLEARANCE_M) & (nodes[:, 2] >= ground_m)
    number = np.full(len(nodes), -1)
    number[clear] = np.arange(int(clear.sum()))
    pairs = _pairs(grid, number.reshape(grid))
    kept = nodes[clear]
    outside = np.linalg.norm(kept - model.hub_w, axis=1) >= model.rotor_radius_m + 13.0
    empty = np.zeros(0)
    roadmap = Roadmap(
        model, airframe_radius_m, ground_m, kept, outside,
        np.zeros(0, np.intp), np.zeros(0, np.intp), empty,
    )  # fmt: skip
    yield None
    passed = []
    for part in np.array_split(pairs, slices):
        limit = np.full(len(part), CLEARANCE_M)
        passed.append(part[roadmap.clear(kept[part[:, 0]], kept[part[:, 1]], limit)])
        yield None
    joined = np.concatenate(passed)
    lengths = np.linalg.norm(kept[joined[:, 0]] - kept[joined[:, 1]], axis=1)
    yield Roadmap(
        model, airframe_radius_m, ground_m, kept, outside, joined[:, 0], joined[:, 1], lengths
    )


def _nodes(model: RotorModel, radii: Float) -> tuple[Float, tuple[int, int, int]]:
    first = model.axes[0] - (model.axes[0] @ model.normal_w) * model.normal_w
    first = first / np.linalg.norm(first)
    second = np.cross(model.normal_w, first)
    angles = np.arange(AZIMUTHS) * (2 * np.pi / AZIMUTHS)
    ring = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
    axial = np.array(AXIAL_M)
    points = (
        model.hub_w
        + radii[:, None, None, None] * ring[None, :, None, :]
        + axial[None, None, :, None] * model.normal_w
    )
    return points.reshape(-1, 3), (len(radii), AZIMUTHS, len(axial))


def _pairs(grid: tuple[int, int, int], number: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the index pairs of neighbours in the cylindrical grid, diagonals included."""
    found = []
    radial, _, axial = grid
    for dr in (0, 1):
        for da in (-1, 0, 1):
            for dx in (-1, 0, 1):
                if (dr, da, dx) <= (0, 0, 0):
                    continue
                here = number[: radial - dr, :, max(0, -dx) : axial - max(0, dx)]
                there = np.roll(number, -da, axis=1)[dr:, :, max(0, dx) : axial + min(0, dx)]
                both = np.stack([here.ravel(), there.ravel()], axis=1)
                found.append(both[(both >= 0).all(axis=1)])
    return np.concatenate(found)
