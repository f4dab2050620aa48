"""The LiDAR's rays through the synthetic world: each from where the sensor was when it fired."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.sensors import Lidar
from drivers.simulated.mesh import Part
from drivers.simulated.mid360_noise import measure, reported_directions
from drivers.simulated.mid360_pattern import RAYS_PER_S, rays
from drivers.simulated.raycaster import NO_TRIANGLE, Raycaster
from drivers.simulated.truth_history import TruthHistory, rotate
from perception.geometry import lidar_in_body
from perception.values import Bytes, Float, Float32

#: Diffuse reflectivity at 905 nm, by `Part`: white gel coat, paint, vegetation, masonry.
_REFLECTIVITY = np.array(
    [0.62, 0.62, 0.62, 0.58, 0.60, 0.55, 0.30, 0.35, 0.30, 0.60, 0.0], np.float32
)


@dataclass(frozen=True, slots=True, eq=False)
class RawScan:
    """All rays of one period in firing order; points are zero where nothing came back."""

    t0_s: float
    points_l: Float32
    offsets_s: Float
    reflectivity: Bytes
    tag: Bytes
    returned: NDArray[np.bool_]
    part: Bytes
    """(N,) `Part` that each ray truly hit; for tests, never sent."""


class Scanner:
    """A MID-360 on the vehicle of a `TruthHistory`."""

    def __init__(
        self,
        caster: Raycaster,
        history: TruthHistory,
        lidar: Lidar,
        seed: int,
        fog_extinction_per_m: float = 0.0,
    ) -> None:
        self._caster, self._history = caster, history
        self._mounting = lidar_in_body(lidar.nose_down_deg).astype(np.float32)
        self._offset_b = np.asarray(lidar.offset_m, np.float32)
        self._blind_m, self._max_m = lidar.blind_range_m, 1.3 * lidar.max_range_m
        self._rng = np.random.default_rng([seed, 0x11D])
        self._fog = fog_extinction_per_m

    def scan(self, t0_s: float, period_s: float) -> RawScan:
        """Return what is measured from ``t0_s`` on; the history must cover the period."""
        directions_l, offsets_s = rays(t0_s, round(period_s * RAYS_PER_S))
        positions, quaternions = self._history.body(t0_s + offsets_s)
        directions_w = rotate(quaternions, directions_l @ self._mounting.T)
        origins_w = positions + rotate(
            quaternions, np.broadcast_to(self._offset_b, positions.shape).copy()
        )
        hits = self._caster.cast(origins_w, directions_w, t0_s + 0.5 * period_s)
        part = np.where(
            hits.triangle == NO_TRIANGLE, np.uint8(Part.SKY), self._caster.mesh.part[hits.triangle]
        )
        seen_m = np.where(hits.range_m <= self._max_m, hits.range_m, np.float32(np.inf))
        cosine = np.einsum("ij,ij->i", hits.normal_w, directions_w)
        returns = measure(
            seen_m, cosine, _REFLECTIVITY[part], self._rng, fog_extinction_per_m=self._fog
        )
        reported_l = reported_directions(directions_l, self._rng)
        points_l = reported_l * returns.ranges_m[:, None]
        return RawScan(
            t0_s=t0_s,
            points_l=points_l,
            offsets_s=offsets_s,
            reflectivity=returns.reflectivity,
            tag=returns.tag,
            returned=returns.returned,
            part=part.astype(np.uint8),
        )
