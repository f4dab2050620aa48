"""Values that sensors deliver and perception consumes. NumPy only: shared with the drivers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Where the body is: local ENU, metres; body FLU."""

    stamp_s: float
    """Mission time."""
    position_w: Float
    """(3,)"""
    quaternion_wb: Float
    """(4,) w x y z: rotates body FLU vectors into the world."""
    velocity_w: Float
    """(3,) m/s"""


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One accumulation period of LiDAR returns, in the sensor's own frame (FLU)."""

    stamp_s: float
    """Mission time of the newest point."""
    sequence: int
    points_l: Float32
    """(N, 3) metres; no-returns are already left out."""
    age_s: Float32
    """(N,) seconds before `stamp_s` at which each point was measured (>= 0)."""
    reflectivity: Bytes
    """(N,)"""
    tag: Bytes
    """(N,) Livox confidence bits; 0 is a trusted return."""
    lost_packets: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One decoded picture of the live stream."""

    stamp_s: float
    """Mission time at which the picture was taken, as well as it is known."""
    sequence: int
    grey: Bytes
    """(H, W)"""
    age_s: float = 0.0
    """From then until it was decoded."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """Optical frame (x right, y down, z along the axis) in the world, at a picture's time."""

    stamp_s: float
    position_w: Float
    rotation_wc: Float
    """(3, 3) rotates optical vectors into the world."""
