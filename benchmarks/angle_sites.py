"""Five sites of the angle bench: what stands round a turbine, for the LiDAR and for pictures."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.picture_background import Backdrop
from perception.values import Float

Part = tuple[Float, NDArray[Any]]
"""Vertices (V, 3) and triangles (T, 3)."""


class Site(StrEnum):
    """Where a turbine stands."""

    FIELDS = "fields"
    RIDGE = "ridge"
    """A steep slope behind the tower, higher than the hub and within the LiDAR's range."""
    FOREST = "forest"
    """Trees of 15-30 m all round."""
    FARM = "farm"
    """A measuring mast as high as the hub beside it, other turbines behind."""
    COAST = "coast"
    """No ground returns; backlight in pictures."""


BACKDROPS = {
    Site.FIELDS: Backdrop.FIELDS,
    Site.RIDGE: Backdrop.RIDGES,
    Site.FOREST: Backdrop.VILLAGE,
    Site.FARM: Backdrop.TURBINES,
    Site.COAST: Backdrop.BACKLIGHT,
}


def site_parts(site: Site, hub: Float, normal: Float, radius_m: float, seed: int) -> list[Part]:
    """Return the meshes of a site, the tower's foot at the origin; the seed is the site's own."""
    rng = np.random.default_rng([seed, 0x51])
    if site is Site.COAST:
        return []
    parts = [_flat(400.0)]
    back = np.array([normal[0], normal[1], 0.0]) / math.hypot(normal[0], normal[1])
    side = np.array([-back[1], back[0], 0.0])
    if site is Site.RIDGE:
        foot = back * rng.uniform(12.0, 22.0)
        top = foot + back * 0.15 * hub[2] + np.array([0, 0, hub[2] * rng.uniform(1.0, 1.4)])
        parts.append(_sheet(foot, top, 300.0 * side))
    if site is Site.FOREST:
        parts += [_tree(rng) for _ in range(80)]
    if site is Site.FARM:
        place = back * rng.uniform(10.0, 25.0) + side * rng.choice([-1, 1]) * (radius_m + 6.0)
        parts.append(_pole(place, hub[2] * rng.uniform(0.9, 1.1), 0.35, 0.25))
    return parts


def _flat(half: float) -> Part:
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0.0]])
    return corners, np.array([[0, 1, 2], [0, 2, 3]])


def _sheet(foot: Float, top: Float, half: Float) -> Part:
    corners = np.stack([foot - half, foot + half, top + half, top - half])
    return corners, np.array([[0, 1, 2], [0, 2, 3]])


def _pole(foot: Float, height: float, low_m: float, high_m: float, sides: int = 10) -> Part:
    turn = np.linspace(0, 2 * np.pi, sides, endpoint=False)[:, None]
    ring = np.concatenate([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    up = np.array([0.0, 0.0, height])
    vertices = np.concatenate([foot + low_m * ring, foot + up + high_m * ring])
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = np.concatenate([np.stack([i, j, i + sides], 1), np.stack([j, j + sides, i + sides], 1)])
    return vertices, faces


def _tree(rng: np.random.Generator) -> Part:
    bearing, away = rng.uniform(0, 2 * math.pi), rng.uniform(15.0, 90.0)
    foot = np.array([away * math.cos(bearing), away * math.sin(bearing), 0.0])
    return _pole(foot, rng.uniform(15.0, 30.0), rng.uniform(2.0, 4.5), 0.1)
