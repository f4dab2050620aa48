"""Straight segments of a picture: grey, blur, Canny, probabilistic Hough transform."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.values import Bytes, Float

#: The width for which lengths in pixels are given; other pictures scale them.
REFERENCE_WIDTH_PX = 640


@dataclass(frozen=True, slots=True)
class HoughSettings:
    """Lengths in pixels of a picture 640 wide."""

    equalise: bool = False
    blur_px: int = 5
    canny_low: float = 25.0
    canny_high: float = 60.0
    rho_px: float = 1.0
    theta_deg: float = 0.5
    votes: int = 30
    min_length_px: float = 40.0
    max_gap_px: float = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """N segments: x right, y down, pixels."""

    ends: Float
    """(N, 2, 2) the two ends, the upper first."""

    def __len__(self) -> int:
        return len(self.ends)

    @property
    def length(self) -> Float:
        """Return the (N,) lengths: the strength of each."""
        return np.asarray(np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1), np.float64)

    @property
    def middle(self) -> Float:
        """Return the (N, 2) middles."""
        return np.asarray(self.ends.mean(axis=1), np.float64)

    @property
    def direction(self) -> Float:
        """Return the (N, 2) unit vectors from the upper to the lower end."""
        along = self.ends[:, 1] - self.ends[:, 0]
        return np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True), np.float64)

    @property
    def angle_deg(self) -> Float:
        """Return (N,) angles from straight down towards the right, in (-90, 90]."""
        along = self.direction
        return np.asarray(np.degrees(np.arctan2(along[:, 0], along[:, 1])), np.float64)

    def distance(self, point: Float) -> Float:
        """Return the (N,) distances of the endless lines from a (2,) point."""
        along, off = self.direction, point - self.middle
        return np.asarray(np.abs(off[:, 0] * along[:, 1] - off[:, 1] * along[:, 0]), np.float64)

    def take(self, which: NDArray[np.bool_]) -> Segments:
        """Return those of an (N,) mask."""
        return Segments(self.ends[which])


def find_segments(grey: Bytes, roll_rad: float, centre: Float, setting: HoughSettings) -> Segments:
    """Return the segments of a picture (H, W), turned upright about ``centre`` (2,)."""
    scale = grey.shape[1] / REFERENCE_WIDTH_PX
    if setting.equalise:
        grey = np.asarray(cv2.equalizeHist(grey), np.uint8)
    size = 2 * round(setting.blur_px * scale / 2 - 0.5) + 1
    smooth = cv2.GaussianBlur(grey, (size, size), 0)
    edges = cv2.Canny(smooth, setting.canny_low, setting.canny_high)
    found = cv2.HoughLinesP(
        edges,
        setting.rho_px,
        math.radians(setting.theta_deg),
        round(setting.votes * scale),
        minLineLength=setting.min_length_px * scale,
        maxLineGap=setting.max_gap_px * scale,
    )
    # OpenCV answers None for an empty picture, which its types do not say.
    ends = np.zeros((0, 2, 2)) if found is None else np.asarray(found, float).reshape(-1, 2, 2)
    return _upright(ends, roll_rad, centre)


def _upright(ends: Float, roll_rad: float, centre: Float) -> Segments:
    """Turn by the camera's roll, so that straight down is (0, 1), and put upper ends first."""
    ends = turned(ends, roll_rad, centre)
    swap = ends[:, 0, 1] > ends[:, 1, 1]
    ends[swap] = ends[swap, ::-1]
    return Segments(ends)


def turned(points: Float, roll_rad: float, centre: Float) -> Float:
    """Return (..., 2) places of a picture whose camera has rolled, in the upright picture.

    A camera that has turned clockwise shows straight down at (sin roll, cos roll).
    """
    c, s = math.cos(roll_rad), math.sin(roll_rad)
    return np.asarray((points - centre) @ np.array([[c, s], [-s, c]]) + centre, np.float64)
