"""Stop angle and hub by the paper's whole method (Shi et al. 2025, Algorithm 1).

A plane, rings along its normal, three intersections, their Fermat point, the angle; again with a
new cloud until two angles agree. One call of `FermatEstimator.update` is one pass of the loop.

Where the search points start. Eq. 1 begins at the drone p_d, Algorithm 1 at p_h^(i-1). From p_d
the rings are centred on the drone's own line of sight along v_n, which misses the hub by as much
as the drone stands beside the shaft; around p_h^(i-1) they close in on the hub with every pass. So
here the line of search runs through p_h^(i-1) along v_n (Algorithm 1), and begins as far before
it as the drone stands (Eq. 1), less the 9 m in which only fog or the airframe itself returns.
"""

from __future__ import annotations

import math

import numpy as np

from config.inspection import FermatMethod
from perception.bri_clustering import cluster_bri
from perception.fermat_point import (
    DegenerateTriangleError,
    FermatHub,
    ObtuseTriangleError,
    fermat_hub,
)
from perception.geometry import stop_angle_difference_deg
from perception.grid_kernel import Tube
from perception.grid_map import GridMap
from perception.ring_search import search_points, search_rings
from perception.rotor import (
    Blade,
    Refusal,
    RefusalCode,
    Rotor,
    angle_of,
    blade_angles_deg,
    direction_at,
)
from perception.rotor_plane import fit_rotor_plane
from perception.values import Float
from perception.voxel_hash import compiled

DOWN_W: Float = np.array([0.0, 0.0, -1.0])
#: Nothing nearer to the drone than this is a blade.
NEAREST_M = 9.0
#: Blades are looked for this far round the prior hub.
REACH_M = 20.0
#: v_n lies so near the line from p_d to p_h^0, seen from above, and out of the level: a rotor leans
#: back. Without these a plane through the tower and the edges of feathered blades holds the most.
MAX_TURN_DEG, LEAN_DEG = 25.0, (-13.0, 5.0)
#: Clouds that M_g is made of, and how far the hub may move before it is begun anew.
MOST_CLOUDS = 8
ANEW_M = 4.0
#: Rings that move by less than this are still within the cells carved before.
SPARE_M = 0.5
#: Mean error of one pass as measured (and printed: 1.15 deg).
SIGMA_DEG = 1.4
#: Arms of a right triangle, as shares of the ring's radius: the hub lies inside the ring.
ARM_SHARE = (0.3, 1.8)


class FermatEstimator:
    """Algorithm 1, one pass a call; keeps p_h^(i-1), a_b^(i-1) and the grid map M_g."""

    def __init__(self, settings: FermatMethod, *, agree_deg: float = 0.5) -> None:
        """Start before the first pass; ``agree_deg`` is epsilon_a."""
        self._settings = settings
        self._agree_deg = agree_deg
        self._grid: GridMap | None = None
        self._tube: Tube | None = None
        self._clouds: list[tuple[Float, Float]] = []
        self._first_hub_w: Float = np.zeros(3)
        self._last: Rotor | None = None
        self.iterations = 0
        self.converged = False
        """Whether the last two angles differ by less than epsilon_a."""

    def update(
        self,
        points_w: Float,
        origins_w: Float,
        prior_hub_w: Float,
        *,
        down_w: Float = DOWN_W,
        reference: str = "gravity",
        stamp_s: float = 0.0,
    ) -> Rotor | Refusal:
        """Return the rotor after one more cloud, or why there is none.

        ``points_w``: (N, 3) P_a, world metres; ``origins_w``: (N, 3) or (3,) the sensor's places;
        ``prior_hub_w``: (3,) p_h^0; ``down_w``: what the angle is measured from.
        """
        self.iterations += 1
        points, origins = self._in_window(points_w, origins_w, prior_hub_w)
        if len(points) < 60:
            return self._refuse(RefusalCode.NO_POINTS, f"{len(points)} points near the prior hub")
        viewpoint = origins.mean(axis=0)
        plane = fit_rotor_plane(
            points,
            viewpoint,
            threshold_m=self._settings.plane_threshold_m,
            ahead_w=prior_hub_w - viewpoint,
            max_turn_deg=MAX_TURN_DEG,
            lean_deg=LEAN_DEG,
        )
        if plane is None:
            return self._refuse(RefusalCode.NO_PLANE, "no upright plane holds the points")
        hub_before = self._hub_before(prior_hub_w)
        found = self._search(hub_before, plane.normal_w, viewpoint, points, origins)
        if isinstance(found, Refusal):
            return self._refuse(found.code, found.text)
        return self._accept(found, plane.normal_w, down_w, reference, stamp_s, len(points))

    def _in_window(self, points_w: Float, origins_w: Float, hub_w: Float) -> tuple[Float, Float]:
        """Keep what lies in the horizontal window towards the prior hub, and round it."""
        points = np.ascontiguousarray(np.asarray(points_w, np.float64).reshape(-1, 3))
        origins = np.asarray(origins_w, np.float64)
        if not len(points):
            return points, np.zeros((1, 3))
        if origins.ndim == 1 or origins.strides[0] == 0:  # one place, told once or for each point
            origins = origins.reshape(-1, 3)[:1]
        half_rad = math.radians(self._settings.window_deg / 2)
        kept: tuple[Float, Float] = _near(
            points, np.ascontiguousarray(origins), np.array(hub_w, np.float64), half_rad,
            NEAREST_M, REACH_M,
        )  # fmt: skip
        return kept

    def _hub_before(self, prior_hub_w: Float) -> Float:
        """Return p_h^(i-1): the last pass's hub, unless the prior has left it behind."""
        last = self._last
        if last is None or float(np.linalg.norm(last.hub_w - prior_hub_w)) > REACH_M / 2:
            return np.asarray(prior_hub_w, np.float64)
        return last.hub_w

    def _fused(self, tube: Tube, hub_w: Float, points: Float, origins: Float) -> GridMap:
        """Return M_g with this cloud and those before it, in the cells that rings can meet.

        The rings move with the hub: where they leave the cells that were carved, the clouds
        remembered are fused anew; else this one is added.
        """
        if self._clouds and float(np.abs(self._first_hub_w - hub_w).max()) > ANEW_M:
            self._clouds.clear()
        if not self._clouds:
            self._first_hub_w = hub_w
        self._clouds = [*self._clouds[1 - MOST_CLOUDS :], (points, origins)]
        grid = self._grid
        if grid is None:
            half_m = self._settings.ring_radius_m + 10.0
            grid = self._grid = GridMap(hub_w, half_m=half_m, resolution_m=self._settings.voxel_m)
        if len(self._clouds) > 1 and self._tube is not None and self._tube.holds(tube):
            grid.fuse(points, origins, self._tube)
            return grid
        self._tube = tube._replace(margin_m=tube.margin_m + SPARE_M)
        grid.restart(hub_w)
        for cloud in self._clouds:
            grid.fuse(*cloud, self._tube)
        return grid

    def _search(
        self, hub_w: Float, normal_w: Float, viewpoint_w: Float, points_w: Float, origins_w: Float
    ) -> FermatHub | Refusal:
        """Search rings until one is cut by three blades (Algorithm 1, lines 4 to 14)."""
        settings = self._settings
        before_m = float(np.clip((hub_w - viewpoint_w) @ normal_w - NEAREST_M, 3.0, 25.0))
        centres = search_points(
            hub_w - before_m * normal_w, normal_w, settings.search_step_m, settings.search_count
        )
        tube = Tube(
            centres[0],
            normal_w,
            settings.search_step_m * settings.search_count,
            settings.ring_radius_m,
            2.0 * settings.voxel_m,
        )
        grid = self._fused(tube, hub_w, points_w, origins_w)
        ring, occupied = search_rings(
            grid, centres, normal_w, settings.ring_radius_m, settings.ring_step_m
        )
        most = 0
        for depth in np.flatnonzero(occupied.sum(axis=1) >= 3):
            cells = grid.cell_centres(centres[depth] + ring[occupied[depth]])
            groups = cluster_bri(
                cells, eps_m=settings.cluster_eps_m, min_samples=settings.cluster_min_samples
            )
            most = max(most, len(groups))
            if len(groups) != 3:
                continue
            try:
                hub = fermat_hub(groups)
            except (ObtuseTriangleError, DegenerateTriangleError):
                continue
            low, high = (share * settings.ring_radius_m for share in ARM_SHARE)
            if low < hub.arms_m.min() and hub.arms_m.max() < high:
                return hub
        if most == 2:
            return Refusal(RefusalCode.TWO_BLADES, "the rings meet two blades only")
        return Refusal(RefusalCode.NO_RING, f"no ring meets three blades (at most {most} groups)")

    def _accept(
        self,
        hub: FermatHub,
        normal_w: Float,
        down_w: Float,
        reference: str,
        stamp_s: float,
        points: int,
    ) -> Rotor:
        angle_deg = stop_angle_deg(hub.blade_directions_w, normal_w, down_w)
        last = self._last
        change = None
        if last is not None:
            change = abs(stop_angle_difference_deg(angle_deg, last.stop_angle_deg))
        self.converged = change is not None and change < self._agree_deg
        blades = tuple(
            Blade(name, direction_at(math.radians(angle), normal_w, down_w), None)
            for name, angle in zip("ABC", blade_angles_deg(angle_deg), strict=True)
        )
        self._last = Rotor(
            stamp_s=stamp_s,
            hub_w=hub.centre_w,
            normal_w=normal_w,
            stop_angle_deg=angle_deg,
            sigma_deg=max(SIGMA_DEG, change or 0.0),
            reference=reference,
            blades=(blades[0], blades[1], blades[2]),
            method="fermat",
            points=points,
        )
        return self._last

    def _refuse(self, code: RefusalCode, text: str) -> Refusal:
        self.converged = False
        return Refusal(code, text)


def stop_angle_deg(blade_directions_w: Float, normal_w: Float, down_w: Float) -> float:
    """Return a_b (degrees, [0, 120)) of blade directions (3, 3), each counted modulo 120 deg."""
    angles = [angle_of(direction, normal_w, down_w) for direction in blade_directions_w]
    # The mean of what repeats every 120 deg is taken on the circle of three times the angle.
    tripled = np.exp(3j * np.array(angles)).sum()
    angle = math.degrees(math.atan2(tripled.imag, tripled.real)) / 3 % 120.0
    return 0.0 if angle >= 120.0 else angle


@compiled
def _near(
    points: Float, origins: Float, hub: Float, half_rad: float, nearest: float, reach: float
) -> tuple[Float, Float]:
    """Return the finite points (M, 3) towards and round a hub, and their origins, (M, 3) or (1, 3).

    ``origins``: (N, 3), or (1, 3) for all; ``half_rad``: of the horizontal window.
    """
    each = len(origins) > 1
    kept, kept_origins = np.empty_like(points), np.empty((len(points) if each else 1, 3))
    kept_origins[0] = origins[0]
    cosine, used = math.cos(min(half_rad, math.pi)), 0
    for n in range(len(points)):
        o = n if each else 0
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        u, v = x - origins[o, 0], y - origins[o, 1]
        range2 = u * u + v * v + (z - origins[o, 2]) ** 2
        # Comparisons with NaN are false.
        if not (range2 > nearest * nearest and range2 < 1e10):
            continue
        off2 = (x - hub[0]) ** 2 + (y - hub[1]) ** 2 + (z - hub[2]) ** 2
        if off2 >= reach * reach:
            continue
        s, t = hub[0] - origins[o, 0], hub[1] - origins[o, 1]
        if u * s + v * t < cosine * math.sqrt((u * u + v * v) * (s * s + t * t)):
            continue
        kept[used, 0], kept[used, 1], kept[used, 2] = x, y, z
        if each:
            kept_origins[used] = origins[o]
        used += 1
    return kept[:used].copy(), kept_origins[: used if each else 1].copy()
