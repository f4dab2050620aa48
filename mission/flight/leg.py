"""A line along a blade: where the vehicle is, and where it looks, at each metre; what it shows."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from perception.values import Float


@dataclass(frozen=True, eq=False)
class Leg:
    """One line along a blade, flown in one go from ``photos[0]`` to ``photos[-1]``."""

    blade: str
    side: str
    root_w: Float
    axis_w: Float
    view_w: Float
    """(3,) unit, from the blade's axis towards the vehicle; leans along the axis where slanted."""
    turn_deg: float
    grid_m: Float
    """(M,) metres, rising."""
    distance_m: Float
    """(M,) distance from the axis at each."""
    footprint_m: float
    photos: tuple[float, ...]
    """Metres, in the order flown."""
    length_m: float
    centre_w: Float
    """(M, 3) from the undeflected axis to the blade's middle as seen from the view: prebend, and
    half the chord's excess on one side of the axis."""
    aside_w: Float
    """(M, 3) from there to what the camera is aimed at; not 0 where the blade is wider than the
    picture and is photographed in rows."""
    blind: bool = False
    """The LiDAR does not see the blade from here: the fitted rotor holds the distance."""
    again: bool = False
    """Flown for gaps of an earlier leg."""
    apparent_w: Float | None = None
    """(M, 3) from the blade's middle to what appears as its middle in a picture: of a chord seen
    aslant the nearer half looks the longer."""

    def distance_at(self, metre: float) -> float:
        """Return the planned distance from the blade's axis."""
        return float(np.interp(metre, self.grid_m, self.distance_m))

    def foot(self, metre: float) -> Float:
        """Return the point (3,) of the blade's axis at a metre."""
        return self.root_w + metre * self.axis_w

    def centre(self, metre: float) -> Float:
        """Return the offset (3,) from the undeflected axis to the blade's middle."""
        return _column(metre, self.grid_m, self.centre_w)

    def aside(self, metre: float) -> Float:
        """Return how far (3,) beside the blade's middle the camera is aimed."""
        return _column(metre, self.grid_m, self.aside_w)

    def target(self, metre: float) -> Float:
        """Return the point (3,) that the camera is aimed at."""
        place = self.foot(metre) + self.centre(metre) + self.aside(metre)
        if self.apparent_w is None:
            return place
        return place + _column(metre, self.grid_m, self.apparent_w)

    def position(self, metre: float) -> Float:
        """Return where the vehicle is (3,) when it looks at a metre."""
        return self.foot(metre) + self.centre(metre) + self.distance_at(metre) * self.view_w

    def beside(self, position_w: Float) -> float:
        """Return the metre that a position (3,) lies beside."""
        return float((position_w - self.root_w) @ self.axis_w)

    def metre_of(self, position_w: Float) -> float:
        """Return the metre that a vehicle at a position (3,) looks at."""
        return self.looked_at(self.beside(position_w))

    def looked_at(self, beside_m: float) -> float:
        """Return the metre looked at from beside another: a leaning view looks elsewhere."""
        first, last = float(self._along_m[0]), float(self._along_m[-1])
        inside = float(np.interp(beside_m, self._along_m, self.grid_m))
        return inside + min(0.0, beside_m - first) + max(0.0, beside_m - last)

    def line(self) -> Float:
        """Return the polyline (K, 3) from the first to the last photo."""
        first, last = self.photos[0], self.photos[-1]
        count = max(2, math.ceil(abs(last - first)) + 1)
        return np.stack([self.position(float(m)) for m in np.linspace(first, last, count)])

    def reversed(self) -> Leg:
        """Return the same line flown the other way."""
        return self.with_photos(self.photos[::-1], self.again)

    def with_photos(self, photos: tuple[float, ...], again: bool) -> Leg:
        """Return the same line with other photos."""
        return replace(self, photos=photos, again=again)

    @cached_property
    def _along_m(self) -> Float:
        """(M,) how far along the axis the vehicle is when it looks at each metre of the grid.

        Where the view leans along the axis and the distance changes, that is not a constant more.
        """
        lean = float(self.view_w @ self.axis_w)
        along = self.grid_m + self.centre_w @ self.axis_w + lean * self.distance_m
        return np.maximum.accumulate(along)

    @cached_property
    def spacing_m(self) -> float:
        """Metres between two photos."""
        apart = [abs(b - a) for a, b in itertools.pairwise(self.photos)]
        return min([self.footprint_m, *apart])


@dataclass(frozen=True, slots=True)
class Unseen:
    """A stretch that no admissible view shows, and why."""

    from_m: float
    to_m: float
    reason: str


@dataclass(frozen=True, slots=True)
class SidePass:
    """All that is flown of one side of one blade."""

    blade: str
    side: str
    legs: tuple[Leg, ...]
    unseen: tuple[Unseen, ...]
    planned_m: float
    """Metres of the blade that the legs show."""
    length_m: float


def _column(metre: float, grid_m: Float, values: Float) -> Float:
    return np.array([np.interp(metre, grid_m, values[:, k]) for k in range(3)])
