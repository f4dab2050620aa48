"""The synthetic world's own section law: a circular root that blends into a cambered airfoil.

A section is given in chord lengths: x from the leading edge (0) to the trailing edge (1), y towards
the suction side. The law belongs to the world alone; perception must not be built on it.
"""

from __future__ import annotations

import numpy as np

from perception.values import Float

#: Points round a section, from the trailing edge over pressure side, leading edge, suction side.
POINTS = 57
_ROUND_ABOVE = 0.98
_AIRFOIL_BELOW = 0.38
_CAMBER = 0.024
_BLUNT = 0.006  # thickness of the trailing edge


def section(thickness: float) -> Float:
    """Return the (POINTS, 2) outline of a section of the given thickness (share of the chord)."""
    # Points crowd at both edges, where the skin curves most.
    turn = np.linspace(0.0, 2.0 * np.pi, POINTS)
    x = 0.5 + 0.5 * np.cos(turn)
    side = np.where(turn <= np.pi, -1.0, 1.0)
    oval = 0.5 * thickness * np.abs(np.sin(turn))
    # The least thick profile keeps a real edge radius: foil sections are never sharp in front.
    foil = thickness * _half_thickness(x) + 0.5 * _BLUNT * x
    camber = _CAMBER * np.sin(np.pi * x**1.15)
    share = float(np.clip((_ROUND_ABOVE - thickness) / (_ROUND_ABOVE - _AIRFOIL_BELOW), 0.0, 1.0))
    share = share * share * (3.0 - 2.0 * share)
    half = (1.0 - share) * oval + share * foil
    return np.stack([x, share * camber + side * half], axis=1)


def _half_thickness(x: Float) -> Float:
    """Return half the unit thickness along the chord: its maximum is 0.5, at a third of it."""
    return np.asarray(0.5 * np.sqrt(x) * (1.0 - x) / 0.3849, np.float64)


def arc_lengths(outline: Float) -> Float:
    """Return (POINTS,) skin lengths from the leading edge, positive on the pressure side."""
    steps = np.linalg.norm(np.diff(outline, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(along[POINTS // 2] - along, np.float64)
