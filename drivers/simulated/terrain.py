"""The ground and what stands on it: gentle hills, trees, buildings. Fixed by the seed.

World ENU, metres. The ground is flat round the tower, so that the tower's foot is at height 0.
"""

from __future__ import annotations

import numpy as np

from drivers.simulated.mesh import Mesh, Part, cone, join, lattice
from perception.values import Float

_HALF_SIZE_M = 900.0
_CELLS = 72
_FLAT_M = 25.0
_WAVES = 6


def ground_height_m(east_m: float, north_m: float, seed: int) -> float:
    """Return the height of the ground at a place."""
    return float(ground_heights_m(np.array([east_m]), np.array([north_m]), seed)[0])


def ground_heights_m(east_m: Float, north_m: Float, seed: int) -> Float:
    """Return the heights of the ground, (N,), at places given by two (N,) arrays.

    A sum of long waves (130-500 m) that grows with the distance from the tower.
    """
    rng = np.random.default_rng([seed, 0x6E])
    bearing = rng.uniform(0.0, 2 * np.pi, _WAVES)
    length = rng.uniform(130.0, 500.0, _WAVES)
    phase = rng.uniform(0.0, 2 * np.pi, _WAVES)
    along = np.outer(east_m, np.cos(bearing)) + np.outer(north_m, np.sin(bearing))
    waves = np.sin(2 * np.pi * along / length + phase) * (length / 110.0)
    distance = np.hypot(east_m, north_m)
    fade = np.clip((distance - _FLAT_M) / 300.0, 0.0, 1.0)
    heights: Float = fade * waves.sum(axis=1) / np.sqrt(_WAVES)
    return heights


def terrain_mesh(seed: int, clear_radius_m: float) -> Mesh:
    """Return ground, trees and buildings; nothing stands nearer to the tower than the radius."""
    ticks = np.linspace(-1.0, 1.0, _CELLS + 1)
    # Finer cells near the tower: where the LiDAR's ground returns are.
    ticks = _HALF_SIZE_M * np.sign(ticks) * np.abs(ticks) ** 1.6
    east, north = np.meshgrid(ticks, ticks, indexing="ij")
    up = ground_heights_m(east.ravel(), north.ravel(), seed).reshape(east.shape)
    ground = lattice(
        np.stack([east, north, up], axis=-1), Part.GROUND, outward=np.array([0, 0, 1.0])
    )
    return join([ground, *_trees(seed, clear_radius_m), *_buildings(seed, clear_radius_m)])


def _places(rng: np.random.Generator, count: int, near_m: float, far_m: float) -> Float:
    bearing = rng.uniform(0.0, 2 * np.pi, count)
    distance = rng.uniform(near_m, far_m, count)
    return np.stack([distance * np.sin(bearing), distance * np.cos(bearing)], axis=1)


def _up(height_m: float) -> Float:
    return np.array([0.0, 0.0, height_m])


def _trees(seed: int, clear_radius_m: float) -> list[Mesh]:
    rng = np.random.default_rng([seed, 0x7E])
    trees: list[Mesh] = []
    for centre in _places(rng, 9, clear_radius_m + 40.0, clear_radius_m + 330.0):
        grove = centre + rng.normal(0.0, 14.0, (7, 2))
        grove = grove[np.hypot(grove[:, 0], grove[:, 1]) > clear_radius_m]
        for east, north in grove:
            foot = np.array([east, north, ground_height_m(float(east), float(north), seed)])
            height, radius = float(rng.uniform(6.0, 15.0)), float(rng.uniform(2.0, 4.0))
            crown = foot + _up(0.2 * height)
            trees.append(cone(crown, foot + _up(height), radius, 0.05, Part.TREE, 9))
            trees.append(cone(foot - _up(0.5), crown, 0.25, 0.2, Part.TREE, 6))
    return trees


def _buildings(seed: int, clear_radius_m: float) -> list[Mesh]:
    rng = np.random.default_rng([seed, 0xB0])
    buildings: list[Mesh] = []
    for east, north in _places(rng, 3, clear_radius_m + 60.0, clear_radius_m + 260.0):
        foot = np.array([east, north, ground_height_m(float(east), float(north), seed) - 1.0])
        radius, height = float(rng.uniform(5.0, 9.0)), float(rng.uniform(4.0, 8.0))
        top = foot + _up(height)
        ridge = foot + _up(height + 3.0)
        buildings.append(cone(foot, top, radius, radius, Part.BUILDING, 4))
        buildings.append(cone(top, ridge, radius, 0.3, Part.BUILDING, 4))
    return buildings
