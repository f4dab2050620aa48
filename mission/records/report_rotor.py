"""The rotor as the viewer in front of it sees it, in the coordinates of its picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mission.records.mission_file import MissionFile

#: Below it the angle's figure does not fit between the tower and the blade.
_NARROW_DEG = 50.0


@dataclass(frozen=True, slots=True)
class Arm:
    """One blade of the rotor's picture: seen from upwind, hub at (0, 0), y down, length 100."""

    name: str
    turn_deg: float
    """Rotation of a blade drawn straight down, as SVG turns: clockwise positive."""
    label_x: float
    label_y: float


@dataclass(frozen=True, slots=True)
class RotorPicture:
    """The rotor as the viewer in front of it sees it."""

    arms: tuple[Arm, ...]
    arc: str
    """SVG path of the stop angle, from straight down to the first blade."""
    arc_label: tuple[float, float]
    arc_anchor: str


def rotor_picture(mission: MissionFile) -> RotorPicture | None:
    """Return the rotor's picture, or None where it was not measured."""
    rotor = mission.rotor
    if rotor is None:
        return None
    arms = []
    for blade in rotor.blades:
        # From straight down, counter-clockwise seen from the front: towards the viewer's right.
        x, y = _towards(blade.angle_deg)
        arms.append(Arm(blade.name, -blade.angle_deg, 113 * x, 113 * y + 4))
    x, y = _towards(rotor.stop_angle_deg)
    label_x, label_y = _towards(rotor.stop_angle_deg / 2)
    arc = f"M 0 46 A 46 46 0 0 0 {46 * x:.2f} {46 * y:.2f}"
    if rotor.stop_angle_deg < _NARROW_DEG:
        return RotorPicture(tuple(arms), arc, (-13, 50), "end")
    return RotorPicture(tuple(arms), arc, (66 * label_x, 66 * label_y + 4), "middle")


def _towards(angle_deg: float) -> tuple[float, float]:
    angle = math.radians(angle_deg)
    return math.sin(angle), math.cos(angle)
