"""Prior hub p_h^0 from the ascent: the tower, and on which side of it the rotor hangs.

Shi et al. 2025, Sec. III-B.1 take p_h^0 from a picture while the drone climbs along the tower, and
name its error as what their method fails by. Here it is found by LiDAR. The tower's axis and top
give the hub to a metre or two but for the overhang; the blades lie in a plane that misses the
tower's axis by the overhang: of all plumb planes round it, the one that explains what stands off
the tower names yaw and side together. Where two explain it alike, the side is unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from config.turbine import Turbine
from perception.rotor_side import arms_height, rotor_side
from perception.tower import Tower, fit_tower
from perception.values import Float
from perception.voxel_hash import EMPTY, Int64, compiled, pack, rebuild, slot_of

#: The site's ground height and the type's tower height together are not worse than this.
MAX_TOP_ERROR_M = 12.0
#: What is seen over less than this share of the tower's length seen before is no better, or a blade
#: that points up or down.
SHORT_SHARE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class SurveyResult:
    """Tower and rotor as far as the ascent has shown them; mirrors the flight's `HubPrior`."""

    stamp_s: float
    tower: Tower
    hub_w: Float
    """(3,) p_h^0; on the tower's axis while the side is unknown."""
    normal_w: Float | None
    """(3,) unit, level, downwind; None: side unknown."""
    sigma_m: float
    """Of `hub_w`; includes the overhang while the side is unknown."""
    yaw_sigma_deg: float


class TowerSurvey:
    """Gathers scans on the way up; the memory is bounded by the turbine's size, not by time."""

    def __init__(
        self,
        *,
        expected_w: Float,
        turbine: Turbine | None,
        search_m: float = 18.0,
        voxel_m: float = 0.35,
        keep_s: float = 120.0,
    ) -> None:
        """Start empty.

        ``expected_w``: (3,) where the tower's foot is said to stand, up to ``search_m`` wrong;
        ``keep_s``: older voxels are left out, for the vehicle's own position drifts.
        """
        self._expected_w = np.asarray(expected_w, np.float64)
        self._turbine = turbine
        self._search_m = search_m
        self._voxel_m = voxel_m
        self._keep_s = keep_s
        self._stamp_s = 0.0
        self._longest: Tower | None = None
        self._count = 0
        self._keys = np.full(1 << 18, EMPTY, np.int64)
        self._rows = np.zeros(1 << 18, np.int64)
        self._key = np.zeros(1 << 17, np.int64)
        self._points = np.zeros((1 << 17, 3), np.float64)
        self._stamps = np.zeros(1 << 17, np.float64)

    @property
    def _rotor_radius_m(self) -> float:
        return 70.0 if self._turbine is None else self._turbine.rotor_radius_m

    def update(self, points_w: Float, stamp_s: float) -> None:
        """Take in one scan: (N, 3) world metres, at mission time ``stamp_s``."""
        self._stamp_s = stamp_s
        points = np.ascontiguousarray(points_w, np.float64)
        if self._count + 4096 > len(self._key):
            self._forget()
        low = self._expected_w[2] + 8.0
        if self._turbine is not None:
            low += max(self._turbine.hub_height_m - self._rotor_radius_m - 25.0, 0.0)
        self._count = _gather(
            points, stamp_s, self._expected_w, self._search_m + 7.0,
            self._search_m + self._rotor_radius_m, low, 1.0 / self._voxel_m,
            self._keys, self._rows, self._key, self._points, self._stamps, self._count,
        )  # fmt: skip

    def result(self) -> SurveyResult | None:
        """Return what is known by now, None while no tower is found."""
        fresh = self._stamps[: self._count] >= self._stamp_s - self._keep_s
        points = self._points[: self._count][fresh]
        tower = fit_tower(
            points,
            expected_xy=self._expected_w[:2],
            turbine=self._turbine,
            search_m=self._search_m,
        )
        if tower is None:
            return None
        tower = self._known(tower)
        if not self._top_is_credible(tower):
            tower = replace(tower, top_m=None)
        hub_z, height_sigma = self._hub_height(tower)
        centre = tower.at_height(hub_z)
        found = rotor_side(points, tower, centre, self._turbine)
        overhang = 4.0 if self._turbine is None else self._turbine.overhang_m
        if found is None:
            sigma = math.hypot(tower.sigma_m, height_sigma, overhang)
            return SurveyResult(self._stamp_s, tower, centre, None, sigma, 180.0)
        reach = found.offset_m if self._turbine is None else overhang
        lift, lift_sigma = arms_height(found.blade, found.upwind_w, height_sigma)
        height_sigma = min(height_sigma, lift_sigma)
        hub = centre + reach * found.upwind_w + np.array([0.0, 0.0, lift])
        sigma = math.hypot(tower.sigma_m, height_sigma, reach * found.sigma_rad, 0.4)
        yaw_sigma_deg = math.degrees(found.sigma_rad)
        return SurveyResult(self._stamp_s, tower, hub, -found.upwind_w, sigma, yaw_sigma_deg)

    def _known(self, tower: Tower) -> Tower:
        """Return the tower, or the one seen before where much more of that was seen.

        Of a large turbine the lower tower is out of view for minutes while the flight goes round
        to the rotor's front: what is then found may be a blade, and a piece of the tower does not
        tell its taper, by which the blades are told from it.
        """
        before = self._longest
        if before is not None and _length_m(tower) < SHORT_SHARE * _length_m(before):
            return before
        if before is None or _length_m(tower) >= _length_m(before):
            self._longest = tower
        return tower

    def _top_is_credible(self, tower: Tower) -> bool:
        """A blade seen beyond the view of the tower can pass for something above its top."""
        if tower.top_m is None or self._turbine is None:
            return True
        expected = float(self._expected_w[2]) + self._turbine.tower_height_m
        return abs(tower.top_m - expected) < MAX_TOP_ERROR_M

    def _hub_height(self, tower: Tower) -> tuple[float, float]:
        """Return the hub's height (z) and its sigma, from the top or from the type."""
        turbine = self._turbine
        if tower.top_m is not None:
            above = 2.0 if turbine is None else turbine.hub_height_m - turbine.tower_height_m
            return tower.top_m + above, 1.0
        if turbine is not None:
            # A blade that points up goes on where the tower ends: the type knows better.
            return float(self._expected_w[2]) + turbine.hub_height_m, 5.0
        return tower.highest_m + 2.0, 30.0

    def _forget(self) -> None:
        """Drop the older half, so that the memory never grows."""
        keep = np.sort(np.argsort(self._stamps[: self._count])[self._count // 2 :])
        count = len(keep)
        self._key[:count] = self._key[keep]
        self._points[:count] = self._points[keep]
        self._stamps[:count] = self._stamps[keep]
        self._count = count
        self._keys.fill(EMPTY)
        rebuild(self._keys, self._rows, self._key, count)


def _length_m(tower: Tower) -> float:
    """Return over which height a tower was seen."""
    return tower.highest_m - float(tower.foot_w[2])


@compiled
def _gather(
    points: Float, stamp: float, expected: Float, tower_reach: float, rotor_reach: float,
    low: float, per_metre: float, keys: Int64, rows: Int64, key: Int64, kept: Float,
    stamps: Float, count: int,
) -> int:  # fmt: skip
    """Keep the first point of each voxel near the tower, or in the rotor's heights."""
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        reach = np.hypot(x - expected[0], y - expected[1])
        if not (reach < rotor_reach and z < 400.0 and z > -400.0):
            continue
        if reach > tower_reach and z < low:
            continue
        one = pack(
            int(np.floor(x * per_metre)), int(np.floor(y * per_metre)), int(np.floor(z * per_metre))
        )
        slot = slot_of(keys, one)
        if keys[slot] == EMPTY:
            if count >= len(key):
                break
            keys[slot] = one
            rows[slot] = count
            key[count] = one
            kept[count, 0], kept[count, 1], kept[count, 2] = x, y, z
            count += 1
        stamps[rows[slot]] = stamp
    return count
