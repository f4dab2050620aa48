"""The tower as the strongest pair of nearly upright lines that leave the picture below."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.baselines.hough_lines import Segments
from perception.values import Float


@dataclass(frozen=True, slots=True)
class TowerSettings:
    """Lengths as shares of the picture's width."""

    max_lean_deg: float = 8.0
    max_taper_deg: float = 5.0
    min_width: float = 0.03
    max_width: float = 0.15
    usual_width: float = 0.07
    """Taken where no pair is found."""
    same_line: float = 0.006
    """Pieces this near to a line belong to it."""
    min_support: float = 0.08
    """Length that each of the two edges must show."""
    low_end: float = 0.72
    """Share of the picture's height below which one edge must reach (the other: 0.8 of that)."""


@dataclass(frozen=True, slots=True, eq=False)
class TowerPair:
    """Two edges of the tower, upright picture, pixels."""

    foot: Float
    """(2,) on the centre line, low in the picture."""
    down: Float
    """(2,) unit: the centre line."""
    width: float
    top_row: float
    """Where the support of the edges ends."""
    seen: bool = True

    def holds(self, segments: Segments) -> NDArray[np.bool_]:
        """Return the (N,) mask of segments that lie on the tower: upright, within its width."""
        if not self.seen:
            return np.zeros(len(segments), bool)
        right = np.array([self.down[1], -self.down[0]])
        off = (segments.middle - self.foot) @ right
        below = segments.ends[:, 1, 1] > self.top_row
        lean = np.degrees(np.arccos(np.clip(segments.direction @ self.down, -1, 1)))
        return np.asarray(below & (np.abs(off) < 0.65 * self.width) & (lean < 6.0), np.bool_)

    def centre_at(self, row: float) -> Float:
        """Return the (2,) point of the centre line at a row."""
        point = self.foot + self.down * (row - self.foot[1]) / self.down[1]
        return np.asarray(point, np.float64)


def unseen_tower(shape: tuple[int, int], setting: TowerSettings) -> TowerPair:
    """Return what stands for a tower that is not seen: straight down, of the usual width."""
    height, width = shape
    foot = np.array([width / 2, 0.9 * height])
    return TowerPair(foot, np.array([0.0, 1.0]), setting.usual_width * width, 0.0, seen=False)


@dataclass(frozen=True, slots=True, eq=False)
class _Edge:
    """Pieces of one upright line."""

    middle: Float
    direction: Float
    support: float
    top: float
    low: float

    def x_at(self, row: float) -> float:
        slope = float(self.direction[0] / self.direction[1])
        return float(self.middle[0]) + slope * (row - float(self.middle[1]))


def find_tower(
    segments: Segments, shape: tuple[int, int], setting: TowerSettings
) -> TowerPair | None:
    """Return the strongest pair of upright edges in a picture of ``shape`` (H, W).

    Strength: the length seen of the weaker edge.
    """
    height, width = shape
    upright = segments.take(np.abs(segments.angle_deg) < setting.max_lean_deg)
    edges = _edges(upright, setting.same_line * width)
    edges = [edge for edge in edges if edge.support > setting.min_support * width]
    best, strength = None, 0.0
    for i, one in enumerate(edges):
        for other in edges[i + 1 :]:
            weaker = min(one.support, other.support)
            if weaker > strength and _is_pair(one, other, height, width, setting):
                best, strength = (one, other), weaker
    if best is None:
        return None
    one, other = best
    row = 0.9 * height
    down = one.direction + other.direction
    foot = np.array([(one.x_at(row) + other.x_at(row)) / 2, row])
    top = max(min(one.top, other.top), 0.0)
    return TowerPair(foot, down / np.linalg.norm(down), _gap(one, other), top)


def _gap(one: _Edge, other: _Edge) -> float:
    """Return the pair's width at the row where both are best known."""
    row = (max(one.top, other.top) + min(one.low, other.low)) / 2
    return abs(one.x_at(row) - other.x_at(row))


def _is_pair(one: _Edge, other: _Edge, height: int, width: int, setting: TowerSettings) -> bool:
    a, b = one.direction, other.direction
    taper = abs(float(a[0] * b[1] - a[1] * b[0]))
    if taper > np.sin(np.radians(setting.max_taper_deg)):
        return False
    low = setting.low_end * height
    if max(one.low, other.low) < low or min(one.low, other.low) < 0.8 * low:
        return False
    return setting.min_width * width < _gap(one, other) < setting.max_width * width


def _edges(upright: Segments, near_px: float) -> list[_Edge]:
    """Join the pieces of the same line, the longest first."""
    edges = []
    left = np.ones(len(upright), bool)
    for k in np.argsort(-upright.length):
        if not left[k]:
            continue
        along = upright.direction[k]
        normal = np.array([along[1], -along[0]])
        off = np.abs((upright.ends - upright.middle[k]) @ normal).max(axis=1)
        same = left & (off < near_px)
        left &= ~same
        edges.append(_joined(upright.take(same | (np.arange(len(upright)) == k))))
    return edges


def _joined(pieces: Segments) -> _Edge:
    ends = pieces.ends.reshape(-1, 2)
    weight = np.repeat(pieces.length, 2)
    middle = weight @ ends / weight.sum()
    spread = (ends - middle) * weight[:, None]
    along = np.linalg.eigh(spread.T @ (ends - middle))[1][:, 1]
    along = along if along[1] > 0 else -along
    rows = pieces.ends[:, :, 1]
    # Two pieces that lie side by side count once.
    seen = np.zeros(int(rows.max()) + 2, bool)
    for top, low in rows:
        seen[max(int(top), 0) : max(int(low), 0) + 1] = True
    return _Edge(
        np.asarray(middle, np.float64),
        np.asarray(along, np.float64),
        float(seen.sum()),
        float(rows.min()),
        float(rows.max()),
    )
