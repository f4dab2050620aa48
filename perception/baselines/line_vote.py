"""The vote: lines through the hub vote for the angle modulo 60 deg; the rays decide the rest.

A blade's line has no sense of direction, so three blades at a, a + 120, a + 240 are three lines
at a modulo 60. The hub is where the vote is clearest along the tower's centre line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from perception.baselines.hough_lines import REFERENCE_WIDTH_PX, Segments
from perception.baselines.tower_pair import TowerPair
from perception.baselines.vision_angle import VisionRefusal, VisionRefusalCode
from perception.values import Float

STEP_DEG = 0.5
_SIXTY = round(60 / STEP_DEG)


@dataclass(frozen=True, slots=True)
class VoteSettings:
    """Lengths as shares of the tower's width in the picture, unless named otherwise."""

    half_chord: float = 1.0
    """A line farther from the hub is not a blade's."""
    distance_sigma: float = 0.5
    longest: float = 0.30
    """A line counts no more than this share of the picture's width."""
    smooth_deg: float = 3.5
    member_deg: float = 7.0
    """Lines this near to the peak are the blades'."""
    weakest: float = 4.0
    """The weakest of the three lines counts so much more than the others."""
    row_step_px: float = 4.0
    """Between candidates of the hub along the tower's centre line, 640 pixels wide."""
    coarse_step_px: float = 10.0
    """The same over the whole picture, where no tower is seen."""
    aside: tuple[float, ...] = (-0.6, -0.3, 0.0, 0.3, 0.6)
    """Candidates beside it: the hub stands before the tower, the camera not before the hub."""
    min_share: float = 0.2
    """Of all votes, that the members of the peak must hold."""
    min_class: float = 0.05
    """Of the members' votes, that each of the three undirected blades must hold."""
    tower_class_deg: float = 8.0
    """A blade this near to the tower's line cannot be told from it."""
    min_margin: float = 1.15
    """The better of a and a + 60 must hold so many times the support of the other."""


@dataclass(frozen=True, slots=True, eq=False)
class Vote:
    """The winner."""

    angle_deg: float
    """[0, 120), from the picture's straight down."""
    share: float
    hub: Float
    """(2,)"""


def vote(
    segments: Segments, tower: TowerPair, shape: tuple[int, int], setting: VoteSettings
) -> Vote | VisionRefusal:
    """Return the hub and the angle with the clearest vote in a picture of ``shape`` (H, W).

    ``segments`` do not hold the tower's.
    """
    if len(segments) < 3:
        text = f"{len(segments)} lines beside the tower's"
        return VisionRefusal(VisionRefusalCode.NO_LINES, text)
    places = _places(tower, shape, setting)
    ballots = np.stack([_ballots(segments, tower, place, shape[1], setting) for place in places])
    classes = _classes(ballots @ _kernel(segments.angle_deg, setting.smooth_deg).T, tower, setting)
    heights = classes.sum(axis=1) + setting.weakest * classes.min(axis=1)
    best, peak = np.unravel_index(int(np.argmax(heights)), heights.shape)
    votes = ballots[best]
    if votes.sum() <= 0:
        return VisionRefusal(VisionRefusalCode.NO_HUB, "no lines meet before the tower")
    return _counted(segments, votes, places[best], STEP_DEG * float(peak), tower, setting)


def _places(tower: TowerPair, shape: tuple[int, int], setting: VoteSettings) -> Float:
    """Return (P, 2) candidates of the hub: along the tower, or anywhere not at the rim."""
    height, width = shape
    if not tower.seen:
        step = setting.coarse_step_px * width / REFERENCE_WIDTH_PX
        x = np.arange(0.15 * width, 0.85 * width, step)
        y = np.arange(0.15 * height, 0.85 * height, step)
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    step = setting.row_step_px * width / REFERENCE_WIDTH_PX
    rows = np.arange(0.02 * height, 0.95 * height, step)
    centres = np.stack([tower.centre_at(float(row)) for row in rows])
    aside = np.zeros((len(setting.aside), 2))
    aside[:, 0] = np.array(setting.aside) * tower.width
    return np.asarray((centres[:, None] + aside[None]).reshape(-1, 2), np.float64)


def _ballots(
    segments: Segments, tower: TowerPair, hub: Float, width_px: int, setting: VoteSettings
) -> Float:
    """Return (N,) votes: lengths, less with the line's distance from the hub."""
    distance = segments.distance(hub)
    strength = np.minimum(segments.length, setting.longest * width_px)
    votes = strength * np.exp(-0.5 * (distance / (setting.distance_sigma * tower.width)) ** 2)
    return np.where(distance < setting.half_chord * tower.width, votes, 0.0)


def _kernel(angle_deg: Float, smooth_deg: float) -> Float:
    """Return (360, N) shares of N lines in each bin of the half circle."""
    bins = np.arange(0.0, 180.0, STEP_DEG)
    off = (angle_deg[None, :] - bins[:, None] + 90.0) % 180.0 - 90.0
    return np.asarray(np.exp(-0.5 * (off / smooth_deg) ** 2), np.float64)


def _classes(histograms: Float, tower: TowerPair, setting: VoteSettings) -> Float:
    """Return (P, 3, 120) votes for the lines at a, a + 60, a + 120 of every a in [0, 60).

    A line that falls on the tower's is granted half of what the others hold.
    """
    classes = histograms.reshape(len(histograms), 3, _SIXTY).copy()
    lines = np.asarray(STEP_DEG * np.arange(3 * _SIXTY).reshape(3, _SIXTY), np.float64)
    on_tower = _off_tower(lines, tower) < setting.tower_class_deg
    mean = classes.sum(axis=1) / 3
    for k in range(3):
        others = (3 * mean - classes[:, k]) / 2
        granted = np.maximum(classes[:, k], 0.5 * others)
        classes[:, k] = np.where(on_tower[k], granted, classes[:, k])
    return np.asarray(classes, np.float64)


def _off_tower(line_deg: Float, tower: TowerPair) -> Float:
    if not tower.seen:
        return np.full(line_deg.shape, 90.0)
    upright = float(np.degrees(np.arctan2(tower.down[0], tower.down[1])))
    return np.asarray(np.abs((line_deg - upright + 90.0) % 180.0 - 90.0), np.float64)


def _counted(
    segments: Segments,
    votes: Float,
    hub: Float,
    peak: float,
    tower: TowerPair,
    setting: VoteSettings,
) -> Vote | VisionRefusal:
    """Return the angle of the peak's members, where they are enough and on all three lines."""
    off = (segments.angle_deg - peak + 30.0) % 60.0 - 30.0
    member = (np.abs(off) < setting.member_deg) & (votes > 0)
    ballots = votes[member]
    share = float(ballots.sum() / votes.sum())
    if share < setting.min_share:
        text = f"the peak holds {100 * share:.0f} % of the votes"
        return VisionRefusal(VisionRefusalCode.NO_VOTE, text)
    angle = peak + float(ballots @ off[member] / ballots.sum())
    for k in range(3):
        line = angle + 60.0 * k
        near = np.abs((segments.angle_deg[member] - line + 90.0) % 180.0 - 90.0) < 30.0
        seen = float(ballots[near].sum()) >= setting.min_class * float(ballots.sum())
        if not seen and float(_off_tower(np.array([line]), tower)[0]) > setting.tower_class_deg:
            text = f"no line at {line % 180.0:.0f} deg, where a blade should be"
            return VisionRefusal(VisionRefusalCode.TWO_BLADES, text)
    return _resolved(segments.take(member), ballots, hub, angle % 60.0, share, setting)


def _resolved(
    members: Segments,
    ballots: Float,
    hub: Float,
    angle_deg: float,
    share: float,
    setting: VoteSettings,
) -> Vote | VisionRefusal:
    """Decide between a and a + 60 by which rays from the hub the members lie on."""
    rel = members.middle - hub
    ray = np.degrees(np.arctan2(rel[:, 0], rel[:, 1]))
    support = []
    for candidate in (angle_deg, angle_deg + 60.0):
        near = np.abs((ray - candidate + 60.0) % 120.0 - 60.0) < 30.0
        support.append(float(ballots[near].sum()))
    if max(support) < setting.min_margin * max(min(support), 1e-9):
        text = f"{angle_deg:.0f} and {angle_deg + 60:.0f} deg are as likely"
        return VisionRefusal(VisionRefusalCode.AMBIGUOUS, text)
    return Vote(angle_deg + (60.0 if support[1] > support[0] else 0.0), share, hub)
