"""A turbine of sampled surfaces seen by a MID-360-like sensor: test data with its own truth."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from config.presets import load_turbine
from perception.geometry import lidar_in_body, rotation_from_euler
from perception.rotor import direction_at, down_in_plane

POINTS_PER_S_SR = 31_000.0


@dataclass
class SyntheticTurbine:
    """A turbine at the origin; `scan` gives world points as the sensor sees them."""

    turbine: object
    stop_angle_deg: float = 30.0
    upwind_deg: float = 90.0  # ENU angle of the direction into which the rotor faces
    pitch_deg: float = 85.0
    seed: int = 0
    trees: bool = True
    spacing_m: float = 0.12
    _cache: dict = field(default_factory=dict)

    @property
    def upwind_w(self):
        a = math.radians(self.upwind_deg)
        return np.array([math.cos(a), math.sin(a), 0.0])

    @property
    def normal_w(self):
        tilt = math.radians(self.turbine.tilt_deg)
        return np.array([0, 0, -math.sin(tilt)]) - math.cos(tilt) * self.upwind_w

    @property
    def hub_w(self):
        shaft = -self.normal_w * self.turbine.overhang_m
        return np.array([shaft[0], shaft[1], self.turbine.hub_height_m])

    def blade_directions(self, turn_deg=0.0):
        down = down_in_plane(self.normal_w, np.array([0.0, 0, -1]))
        cone = math.radians(self.turbine.cone_deg)
        return [
            direction_at(
                math.radians(self.stop_angle_deg + turn_deg + 120 * k), self.normal_w, down, cone
            )
            for k in range(3)
        ]

    def surfaces(self, turn_deg=0.0):
        """Return points (N, 3), outward normals (N, 3) and the area of each (N,)."""
        if turn_deg not in self._cache:
            rng = np.random.default_rng(self.seed)
            parts = [self._tower(rng), self._nacelle(rng)]
            parts += [self._blade(rng, d) for d in self.blade_directions(turn_deg)]
            if self.trees:
                parts += [self._ground(rng)]
            self._cache = {
                turn_deg: tuple(np.concatenate([part[k] for part in parts]) for k in range(3))
            }
        return self._cache[turn_deg]

    def _tower(self, rng):
        t = self.turbine
        r0, r1, h = t.tower_base_diameter_m / 2, t.tower_top_diameter_m / 2, t.tower_height_m
        count = int(math.pi * (r0 + r1) * h / self.spacing_m**2)
        z, a = rng.uniform(0, h, count), rng.uniform(-math.pi, math.pi, count)
        r = r0 + (r1 - r0) * z / h
        normal = np.stack([np.cos(a), np.sin(a), np.zeros(count)], 1)
        points = normal * r[:, None] + np.stack([0 * z, 0 * z, z], 1)
        return points, normal, np.full(count, 2 * math.pi * h * (r0 + r1) / 2 / count)

    def _nacelle(self, rng):
        t = self.turbine
        half = np.array([t.nacelle_length_m, t.nacelle_width_m, t.nacelle_height_m]) / 2
        side = np.array([-self.upwind_w[1], self.upwind_w[0], 0.0])
        axes = np.stack([-self.upwind_w, side, [0, 0, 1.0]])
        # From just behind the tower-side of the hub to its length downwind.
        centre = np.array([0, 0, t.hub_height_m]) - self.upwind_w * (half[0] - 2.0)
        rows = []
        for k in range(3):
            others = [j for j in range(3) if j != k]
            area = 4 * half[others[0]] * half[others[1]]
            for sign in (-1, 1):
                count = int(area / self.spacing_m**2)
                local = rng.uniform(-1, 1, (count, 3)) * half
                local[:, k] = sign * half[k]
                normal = np.tile(sign * axes[k], (count, 1))
                rows.append((centre + local @ axes, normal, np.full(count, area / count)))
        ball = rng.normal(0, 1, (int(40 / self.spacing_m**2), 3))
        ball /= np.linalg.norm(ball, axis=1, keepdims=True)
        r = t.hub_radius_m * 1.05
        area = np.full(len(ball), 4 * np.pi * r * r / len(ball))
        rows.append((self.hub_w + r * ball, ball, area))
        return tuple(np.concatenate([row[k] for row in rows]) for k in range(3))

    def _blade(self, rng, direction):
        t = self.turbine
        b = t.blade
        clockwise = np.cross(self.normal_w, direction)
        clockwise /= np.linalg.norm(clockwise)
        upwind = np.cross(direction, clockwise)
        upwind *= -np.sign(upwind @ self.normal_w)
        count = int(2.1 * np.mean(b.chord_m) * t.blade_length_m / self.spacing_m**2)
        s, x = rng.uniform(0, 1, count), rng.uniform(0, 1, count)
        face = rng.choice([-1.0, 1.0], count)
        chord = np.interp(s, b.span, b.chord_m)
        thick = np.interp(s, b.span, b.thickness)
        axis = np.interp(s, b.span, b.pitch_axis)
        turn = np.radians(np.interp(s, b.span, b.twist_deg) + self.pitch_deg)

        def outline(at):
            naca = 5 * (0.2969 * np.sqrt(at) - 0.126 * at - 0.3516 * at**2 + 0.2843 * at**3
                        - 0.1015 * at**4)  # fmt: skip
            circle = np.sqrt(np.maximum(at * (1 - at), 0))
            blend = np.clip((thick - 0.4) / 0.6, 0, 1)
            return thick * (blend * circle + (1 - blend) * naca)

        le = np.cos(turn)[:, None] * clockwise + np.sin(turn)[:, None] * upwind
        ps = np.cos(turn)[:, None] * upwind - np.sin(turn)[:, None] * clockwise
        y = face * outline(x)
        slope = face * (outline(np.clip(x + 1e-3, 0, 1)) - outline(np.clip(x - 1e-3, 0, 1))) / 2e-3
        along = (axis - x) * chord
        radius = t.hub_radius_m + s * t.blade_length_m
        bend = np.interp(s, b.span, b.prebend_m)
        points = self.hub_w + radius[:, None] * direction + bend[:, None] * upwind
        points = points + along[:, None] * le + (y * chord)[:, None] * ps
        normal = face[:, None] * (ps + slope[:, None] * le)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        area = 2 * chord * np.sqrt(1 + slope**2) * t.blade_length_m / count
        return points, normal, np.minimum(area, 0.2)

    def _ground(self, rng):
        count = 40_000
        xy = rng.uniform(-130, 130, (count, 2))
        z = 1.5 * np.sin(xy[:, 0] / 25) + 1.5 * np.cos(xy[:, 1] / 31) - 2.0
        up = np.tile([0.0, 0.0, 1.0], (count, 1))
        ground = np.column_stack([xy, z])
        places = rng.uniform(-100, 100, (60, 2))
        places = places[np.linalg.norm(places, axis=1) > 12]
        crowns = rng.normal(0, 1, (len(places), 400, 3))
        crowns /= np.linalg.norm(crowns, axis=2, keepdims=True)
        trees = crowns * (2.5, 2.5, 5.0) + np.pad(places, ((0, 0), (0, 1)))[:, None] + (0, 0, 7)
        area = [np.full(count, 260 * 260 / count), np.full(trees.size // 3, 0.35)]
        return (
            np.concatenate([ground, trees.reshape(-1, 3)]),
            np.concatenate([up, crowns.reshape(-1, 3)]),
            np.concatenate(area),
        )

    def scan(self, position_w, seconds=0.5, *, heading_w=None, noise_m=0.02, seed=1,
             max_range_m=70.0, turn_deg=0.0, pose_noise_m=0.0):  # fmt: skip
        """Return world points and the sensor's place, looking at the tower from a place."""
        rng = np.random.default_rng(seed)
        position = np.asarray(position_w, float)
        points, normal, area = self.surfaces(turn_deg)
        offset = points - position
        reach = np.linalg.norm(offset, axis=1)
        cos = -np.einsum("ij,ij->i", offset, normal) / reach
        ahead = -position if heading_w is None else np.asarray(heading_w, float)
        yaw = math.atan2(ahead[1], ahead[0])
        local = offset @ (rotation_from_euler(0, 0, yaw) @ lidar_in_body(23.0))
        elevation = np.degrees(np.arcsin(local[:, 2] / reach))
        seen = (cos > 0.1) & (reach < max_range_m) & (elevation > -7) & (elevation < 52)
        index = np.flatnonzero(seen)
        azimuth = np.degrees(np.arctan2(local[index, 1], local[index, 0]))
        index = index[_unoccluded(azimuth, elevation[index], reach[index])]
        expected = POINTS_PER_S_SR * seconds * area[index] * cos[index] / reach[index] ** 2
        # Returns thin out towards the end of the range.
        expected *= np.clip(1.3 - reach[index] / max_range_m, 0.1, 1)
        index = np.repeat(index, rng.poisson(expected))
        ray = offset[index] / reach[index, None]
        jitter = rng.normal(0, 0.03, (len(index), 3))
        noisy = points[index] + jitter + ray * rng.normal(0, noise_m, (len(index), 1))
        return noisy + rng.normal(0, pose_noise_m, 3), position


def _unoccluded(azimuth, elevation, reach, cell_deg=0.6):
    columns = (azimuth / cell_deg).astype(int) + 400
    rows = (elevation / cell_deg).astype(int) + 100
    cell = rows * 800 + columns
    nearest = np.full(cell.max() + 1 if len(cell) else 1, np.inf)
    np.minimum.at(nearest, cell, reach)
    return reach < nearest[cell] + 2.5


@pytest.fixture
def synthetic_turbine():
    """Return a factory of turbines: ``synthetic_turbine("iea-3.4-130", scale=0.6, ...)``."""

    def make(name="nrel-1.72-103", scale=0.7, **settings):
        return SyntheticTurbine(load_turbine(name, scale), **settings)

    return make
