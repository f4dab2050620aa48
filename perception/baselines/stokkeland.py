"""Stop angle from one picture by Hough lines and a vote: 'our reading' of Stokkeland et al. 2015.

What is known of the publication (M. Stokkeland, K. Klausen, T. A. Johansen, ICUAS 2015) is its
abstract and what Shi et al. 2025 say of it: a Hough transform detects tower, hub and blades, a
voting algorithm tells blade lines from others. Nothing further could be had. These choices are
ours, and every figure measured with this file is a figure of our reading:

- Edges: 5 x 5 Gaussian blur, Canny 25 / 60, no histogram equalisation. Lines: the probabilistic
  Hough transform, 1 px and 0.5 deg, 30 votes, gaps to 5 px, and at least 40 px long (at 20-30 m a
  blade is longer than 150). Pixels are those of a picture 640 wide; others scale them by width.
- The camera's reported roll is undone before anything is called upright. ``matrix`` serves for the
  principal point alone: no distance is known, so no width in metres is used.
- Tower: of all pairs of lines within 8 deg of upright and 5 deg of each other, 3-15 % of the
  picture apart, that reach into its lower part, the one whose weaker edge is seen over the longest
  stretch. The sign of the step of brightness is not asked for: a tower lit from the side is
  brighter than the land on one side and darker on the other. Where no pair is found, 7 % of the
  picture's width and straight down stand in, and the hub may be anywhere.
- Hub: not an upper end of the pair, which a blade or a shadow often hides, but the place along its
  centre line (and up to 0.6 of its width beside it: the hub stands before the tower) where the vote
  is clearest. No prior hub is used.
- Vote: the tower's own lines left out, a line that passes the hub within the tower's width gives
  its length (up to 30 % of the picture's width, so that a horizon does not outvote all), less with
  its distance from the hub, to its angle modulo 60 deg, smoothed by 3.5 deg; the weakest of the
  three lines counts four times more. Accepted where the peak holds 20 % of the votes there and each
  of three blades some, but one that would hang before the tower.
- The 60 deg ambiguity: the lines' middles must lie on the rays of a rather than of a + 60, by 15 %.
- The result is the mean angle of the peak's lines, weighted by their votes, relative to the tower's
  own line rather than to the picture's straight down.
- The numbers were chosen on 48 rendered pictures of seeds of their own, then frozen.
- The method's tracking over frames (a Kalman filter) is left out: one picture, one answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from perception.baselines.hough_lines import HoughSettings, find_segments, turned
from perception.baselines.line_vote import VoteSettings, vote
from perception.baselines.tower_pair import TowerSettings, find_tower, unseen_tower
from perception.baselines.vision_angle import VisionAngle, VisionRefusal, VisionRefusalCode
from perception.values import Bytes, Float


@dataclass(frozen=True, slots=True)
class StokkelandSettings:
    """Parameters of the steps."""

    lines: HoughSettings = field(default_factory=HoughSettings)
    tower: TowerSettings = field(default_factory=TowerSettings)
    votes: VoteSettings = field(default_factory=VoteSettings)


def estimate_stop_angle(
    grey: Bytes, roll_rad: float, matrix: Float, settings: StokkelandSettings | None = None
) -> VisionAngle | VisionRefusal:
    """Return the stop angle that a picture shows, or why none can be read.

    ``grey``: (H, W) taken in front of the rotor; ``roll_rad``: how far the camera is turned
    clockwise about its axis, seen from behind it; ``matrix``: (3, 3) pinhole.
    """
    setting = settings or StokkelandSettings()
    shape = (grey.shape[0], grey.shape[1])
    centre = np.array([matrix[0, 2], matrix[1, 2]])
    segments = find_segments(grey, roll_rad, centre, setting.lines)
    if len(segments) < 4:
        return VisionRefusal(VisionRefusalCode.NO_LINES, f"{len(segments)} lines in the picture")
    tower = find_tower(segments, shape, setting.tower)
    if tower is None:
        tower = unseen_tower(shape, setting.tower)
    others = segments.take(~tower.holds(segments))
    found = vote(others, tower, shape, setting.votes)
    if isinstance(found, VisionRefusal):
        return found
    lean_deg = math.degrees(math.atan2(tower.down[0], tower.down[1]))
    return VisionAngle(
        stop_angle_deg=(found.angle_deg - lean_deg) % 120.0,
        hub_px=turned(found.hub, -roll_rad, centre),
        tower_width_px=tower.width,
        peak_share=found.share,
    )
