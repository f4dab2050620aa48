"""What stands behind the rotor: ridges, other turbines, a village, roads, clouds, a low sun.

World ENU, metres, in the frame of the scene's points. Everything is drawn by a seed and lies in
the sector that the camera looks into, so that each kind shows what it is named after.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from drivers.simulated.light import Light
from drivers.simulated.mesh import Mesh, Part, build, join, lattice
from perception.values import Float, Float32


class Backdrop(StrEnum):
    """Kinds of background; every one has farmland, a track and some weather."""

    FIELDS = "fields"
    RIDGES = "ridges"
    TURBINES = "turbines"
    VILLAGE = "village"
    CLOUDS = "clouds"
    BACKLIGHT = "backlight"


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """Surroundings of one picture."""

    backdrop: Backdrop
    mesh: Mesh
    light: Light
    site: Float32
    """(7,) clouds' scale, offset x, offset y and sharpness; parcels' bearing, width; wildness."""
    roads: Float32
    """(R, 7) unit normal x, y, offset, half width, bend, its wavelength, albedo."""
    trails: Float32
    """(T, 6) contrails: normal (3), offset, half width, brightness."""


def draw_site(backdrop: Backdrop, look_w: Float, turbine: Mesh, rng: np.random.Generator) -> Site:
    """Draw the surroundings seen along ``look_w`` (3,)."""
    bearing = math.atan2(look_w[1], look_w[0])
    ground = _Ground(backdrop, bearing, rng)
    parts = [ground.mesh(), *_trees(ground, bearing, rng)]
    if backdrop is Backdrop.VILLAGE:
        parts += _village(ground, bearing, rng)
    if backdrop is Backdrop.TURBINES or (backdrop is Backdrop.RIDGES and rng.random() < 0.4):
        parts += _other_turbines(ground, bearing, turbine, rng)
    wild = 1.6 if backdrop is Backdrop.RIDGES else rng.uniform(0.0, 0.9)
    sharp = rng.uniform(5.0, 14.0) if backdrop is Backdrop.CLOUDS else rng.uniform(1.5, 8.0)
    site = (
        rng.uniform(0.8, 2.5), rng.uniform(0, 90), rng.uniform(0, 90), sharp,
        rng.uniform(0, math.pi), rng.uniform(25.0, 120.0), wild,
    )  # fmt: skip
    return Site(
        backdrop,
        join(parts),
        _light(backdrop, bearing, rng),
        np.array(site, np.float32),
        _roads(backdrop, bearing, rng),
        _trails(backdrop, look_w, rng),
    )


def _light(backdrop: Backdrop, bearing: float, rng: np.random.Generator) -> Light:
    overcast = float(rng.choice([0.05, 0.3, 0.6, 0.95]))
    elevation, azimuth = rng.uniform(math.radians(18), math.radians(62)), rng.uniform(0, 2 * np.pi)
    if backdrop is Backdrop.BACKLIGHT:
        overcast = float(rng.uniform(0.0, 0.3))
        elevation = rng.uniform(math.radians(7), math.radians(34))
        azimuth = bearing + rng.uniform(-0.6, 0.6)
    if backdrop is Backdrop.CLOUDS:
        overcast = float(rng.uniform(0.25, 0.6))
    level = math.cos(elevation)
    sun = (level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation))
    direct = 1.15 * math.exp(-0.14 / (math.sin(elevation) + 0.03)) * (1.0 - overcast)
    diffuse = min(1.0, math.degrees(elevation) / 30 + 0.3) * (0.16 + 0.22 * overcast)
    haze = math.exp(rng.uniform(math.log(4e-5), math.log(7e-4)))
    return Light(np.array(sun, np.float32), direct, diffuse, overcast, haze)


class _Ground:
    """Heights by value noise: rolling land, and mountains that outgrow the hub for `RIDGES`."""

    RADII = 150
    BEARINGS = 420

    def __init__(self, backdrop: Backdrop, bearing: float, rng: np.random.Generator) -> None:
        self._bearing = bearing
        self._shift = rng.uniform(0, 1000, 2)
        self._rolling_m = float(rng.uniform(5.0, 40.0))
        ridges = backdrop is Backdrop.RIDGES
        self._mountain_m = float(rng.uniform(300.0, 800.0) if ridges else rng.uniform(0.0, 130.0))
        self._from_m = float(rng.uniform(60.0, 600.0) if ridges else 1500.0)
        self._size_m = float(rng.uniform(500.0, 1500.0))

    def height_m(self, x: Float, y: Float) -> Float:
        """Return heights (N,) at places (N,); flat round the tower."""
        far = np.hypot(x, y)
        u, v = x + 1000 * self._shift[0], y + 1000 * self._shift[1]
        rolling = self._rolling_m * (_noise(u / 330, v / 330) - 0.5)
        crest = np.zeros_like(x)
        size, weight = self._size_m, 0.55
        for _ in range(5):
            crest += weight * (1 - np.abs(2 * _noise(u / size, v / size) - 1)) ** 2
            size, weight = size / 2.1, weight * 0.4
        rise = np.clip((far - self._from_m) / 900.0, 0, 1)
        fade = np.clip((far - 60.0) / 300.0, 0, 1)
        return np.asarray(fade * rolling + rise * self._mountain_m * crest, np.float64)

    def mesh(self) -> Mesh:
        """Return the ground out to 7 km, finest in front of the camera's look."""
        radius = np.concatenate([[0.0], np.geomspace(8.0, 7000.0, self.RADII)])
        # Denser bearings where the camera looks.
        even = np.linspace(-np.pi, np.pi, self.BEARINGS)
        turn = self._bearing + even - 0.75 * np.sin(even)
        r, t = np.meshgrid(radius, turn, indexing="ij")
        x, y = r * np.cos(t), r * np.sin(t)
        z = self.height_m(x.ravel(), y.ravel()).reshape(x.shape)
        grid = np.stack([x, y, z], axis=-1)
        return lattice(grid, Part.GROUND, outward=np.array([0.0, 0.0, 1.0]))

    def at(self, x: float, y: float) -> Float:
        """Return the (3,) place on the ground."""
        return np.array([x, y, float(self.height_m(np.array([x]), np.array([y]))[0])])


def _noise(x: Float, y: Float) -> Float:
    i, j = np.floor(x), np.floor(y)
    u, v = x - i, y - j
    u, v = u * u * u * (u * (6 * u - 15) + 10), v * v * v * (v * (6 * v - 15) + 10)
    low = _hash(i, j) * (1 - u) + _hash(i + 1, j) * u
    high = _hash(i, j + 1) * (1 - u) + _hash(i + 1, j + 1) * u
    return np.asarray(low * (1 - v) + high * v, np.float64)


def _hash(i: Float, j: Float) -> Float:
    n = i.astype(np.int64) * 374761393 + j.astype(np.int64) * 668265263
    n = (n ^ ((n & 0xFFFFFFFF) >> 13)) * 1274126177
    return np.asarray(((n ^ ((n & 0xFFFFFFFF) >> 16)) & 0xFFFF) / 65535.0, np.float64)


def _in_sector(
    bearing: float, near_m: float, far_m: float, half_rad: float, rng: np.random.Generator
) -> tuple[float, float]:
    turn, far = (
        bearing + rng.uniform(-half_rad, half_rad),
        math.sqrt(rng.uniform(near_m**2, far_m**2)),
    )
    return far * math.cos(turn), far * math.sin(turn)


def _trees(ground: _Ground, bearing: float, rng: np.random.Generator) -> list[Mesh]:
    trees = []
    for _ in range(int(rng.integers(6, 26))):
        x, y = _in_sector(bearing, 90.0, 900.0, 0.8, rng)
        along = rng.normal(0, 1, 2) * rng.uniform(0, 40)
        for _ in range(int(rng.integers(3, 16))):
            place = rng.uniform(-1, 1) * along + rng.normal(0, 6, 2)
            foot = ground.at(x + place[0], y + place[1])
            trees.append(_tree(foot, rng))
    return trees


def _tree(foot: Float, rng: np.random.Generator) -> Mesh:
    height, width = rng.uniform(6, 18), rng.uniform(2, 5)
    rings = []
    for share in np.linspace(0.0, 1.0, 7):
        turn = np.linspace(0, 2 * np.pi, 10)
        size = width * (0.25 + 1.5 * math.sqrt(max(0.0, share * (1 - share)))) * (share < 1)
        wobble = size * rng.uniform(0.75, 1.25, 10)
        wobble[-1] = wobble[0]
        z = np.full(10, 1.0 + share * height)
        rings.append(foot + np.stack([wobble * np.cos(turn), wobble * np.sin(turn), z], axis=1))
    return lattice(np.stack(rings), Part.TREE)


def _village(ground: _Ground, bearing: float, rng: np.random.Generator) -> list[Mesh]:
    """Houses in rows along lanes, a church and walls, 90-600 m away."""
    parts = []
    for _ in range(int(rng.integers(5, 9))):
        x, y = _in_sector(bearing, 110.0, 480.0, 0.5, rng)
        lane = rng.uniform(0, np.pi)
        for row in range(-2, 3):
            for place in range(-5, 6):
                if rng.random() < 0.25:
                    continue
                u = place * 19.0 + rng.normal(0, 2.5)
                v = row * 26.0 + rng.normal(0, 2.5)
                px = x + u * math.cos(lane) - v * math.sin(lane)
                py = y + u * math.sin(lane) + v * math.cos(lane)
                if math.hypot(px, py) > 60.0:
                    size = (rng.uniform(8, 15), rng.uniform(6, 10), rng.uniform(3, 7.5))
                    turn = lane + rng.normal(0, 0.04) + (np.pi / 2 if rng.random() < 0.3 else 0)
                    parts.append(_house(ground.at(px, py), turn, size))
    return parts


def _house(foot: Float, turn: float, size: tuple[float, float, float]) -> Mesh:
    """Return a box with a gabled roof; corners are not shared, so that edges stay sharp."""
    l, w, h = size[0] / 2, size[1] / 2, size[2]
    top = h + 0.75 * w
    a = [(-l, -w, -2.0), (l, -w, -2.0), (l, w, -2.0), (-l, w, -2.0)]
    b = [(x, y, h) for x, y, _ in a]
    r = [(-l, 0.0, top), (l, 0.0, top)]
    quads = [
        (a[0], a[1], b[1], b[0]), (a[1], a[2], b[2], b[1]), (a[2], a[3], b[3], b[2]),
        (a[3], a[0], b[0], b[3]), (b[0], b[1], r[1], r[0]), (b[2], b[3], r[0], r[1]),
        (b[1], b[2], r[1], r[1]), (b[3], b[0], r[0], r[0]),
    ]  # fmt: skip
    corners = np.array(quads).reshape(-1, 3)
    c, s = math.cos(turn), math.sin(turn)
    vertices = foot + corners @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    first = np.arange(len(quads))[:, None] * 4
    faces = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    return build(vertices, faces, Part.BUILDING)


def _other_turbines(
    ground: _Ground, bearing: float, turbine: Mesh, rng: np.random.Generator
) -> list[Mesh]:
    """Two to six more of the same type, each with an angle and a yaw of its own."""
    others = []
    rotor = turbine.vertices[: _rotor_vertices(turbine)].astype(float)
    hub = rotor.mean(axis=0)
    for _ in range(int(rng.integers(2, 7))):
        x, y = _in_sector(bearing, 170.0, 900.0, 0.45, rng)
        vertices = turbine.vertices.astype(float).copy()
        level = np.array([math.cos(bearing), math.sin(bearing), 0.0])
        turned = _about(level, rng.uniform(0, 2 * np.pi / 3))
        vertices[: len(rotor)] = hub + (rotor - hub) @ turned.T
        yaw = _about(np.array([0, 0, 1.0]), rng.normal(0, 0.15))
        normals = turbine.normals.astype(float)
        normals[: len(rotor)] = normals[: len(rotor)] @ turned.T
        others.append(
            Mesh(
                (vertices @ yaw.T + ground.at(x, y)).astype(np.float32),
                turbine.triangles,
                (normals @ yaw.T).astype(np.float32),
                np.zeros_like(turbine.metre),
                turbine.arc,
                np.full_like(turbine.part, int(Part.OTHER_TURBINE)),
            )
        )
    return others


def _rotor_vertices(turbine: Mesh) -> int:
    """Return how many vertices belong to the blades, which stand first in the mesh."""
    return int(turbine.triangles[turbine.part <= int(Part.BLADE_2)].max()) + 1


def _about(axis: Float, angle_rad: float) -> Float:
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned = np.eye(3) + math.sin(angle_rad) * cross + (1 - math.cos(angle_rad)) * (cross @ cross)
    return np.asarray(turned, np.float64)


def _roads(backdrop: Backdrop, bearing: float, rng: np.random.Generator) -> Float32:
    """Return roads across the sector; the first is the service track to the turbine."""
    rows = []
    count = int(rng.integers(1, 4)) + (2 if backdrop is Backdrop.VILLAGE else 0)
    for k in range(count):
        turn = rng.uniform(0, np.pi)
        middle = 25.0 if k == 0 else rng.uniform(120, 600)
        x, y = middle * math.cos(bearing), middle * math.sin(bearing)
        nx, ny = math.cos(turn), math.sin(turn)
        bend = 0.0 if rng.random() < 0.5 else rng.uniform(5, 40)
        wave, albedo = rng.uniform(60, 200), rng.choice([0.08, 0.12, 0.26, 0.35])
        rows.append((nx, ny, nx * x + ny * y, rng.uniform(1.8, 5.0), bend, wave, albedo))
    return np.array(rows, np.float32)


def _trails(backdrop: Backdrop, look_w: Float, rng: np.random.Generator) -> Float32:
    """Return contrails that cross the view, for some cloudy skies."""
    count = int(rng.integers(0, 4)) if backdrop is Backdrop.CLOUDS else 0
    rows = []
    for _ in range(count):
        normal = np.cross(look_w + np.array([0, 0, rng.uniform(0.1, 0.5)]), rng.normal(size=3))
        normal /= np.linalg.norm(normal)
        rows.append((*normal, 0.0, rng.uniform(0.002, 0.012), rng.uniform(0.15, 0.5)))
    return np.array(rows, np.float32).reshape(-1, 6)
