"""What a vision method answers: a stop angle in the picture, or why there is none."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from perception.values import Float


class VisionRefusalCode(StrEnum):
    """Why no angle was given out."""

    NO_LINES = "no_lines"
    NO_HUB = "no_hub"
    NO_VOTE = "no_vote"
    TWO_BLADES = "two_blades"
    AMBIGUOUS = "ambiguous"


@dataclass(frozen=True, slots=True)
class VisionRefusal:
    """A typed 'no angle', with the reason in words."""

    code: VisionRefusalCode
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class VisionAngle:
    """A stop angle as the picture shows it."""

    stop_angle_deg: float
    """[0, 120): from the tower, pointing down, to the first blade on its right."""
    hub_px: Float
    """(2,) in the picture as given: x right, y down."""
    tower_width_px: float
    peak_share: float
    """Share of all votes that fell on the winning angle."""
