"""What every reader of a cloud gives back."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from perception.values import Float


@dataclass(frozen=True, slots=True, eq=False)
class CloudFile:
    """Points of a file in the order stored, nothing left out but what a sensor never measured."""

    points: Float
    """(N, 3) as stored."""
    viewpoint: Float | None = None
    """(3,) or (N, 3) where the sensor stood, where the file says so."""
    time_s: Float | None = None
    """(N,) on the clock of the poses, or the sensor's own."""
    arrival_s: Float | None = None
    """(N,) on the clock of the computer that recorded, where it is known too."""
    trusted: NDArray[np.bool_] | None = None
    """(N,) False where the sensor itself doubts the return."""
    mounting: tuple[Float, Float] | None = None
    """Rotation (3, 3) and offset (3,) of the sensor in the body, where the file says so."""
    in_sensor_frame: bool = False
    """Whether the format stores what the sensor saw, so that poses are needed."""
    step_m: float = 0.0
    """By how much neighbouring 32-bit values differ at the largest coordinate."""
    notes: tuple[str, ...] = field(default_factory=tuple)
    """What was wrong without making the file useless, a sentence each."""


def float_step_m(values: NDArray[np.generic]) -> float:
    """Return the spacing of the stored type at its largest finite value; 0 for other types."""
    if values.dtype.kind != "f" or not values.size:
        return 0.0
    with np.errstate(invalid="ignore"):
        wide = values.astype(np.float64)
    largest = np.abs(wide[np.isfinite(wide)]).max(initial=0.0)
    return float(np.spacing(values.dtype.type(largest)))
