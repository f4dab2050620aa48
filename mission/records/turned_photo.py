"""A photo turned along its blade: root to the left, about one metre of it, at one scale.

What two photos show of the same place then lies at the same place in both. Turned and scaled only,
never mirrored.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from mission.records.photo_record import PhotoRecord, View
from perception.values import Float

#: The direction of the blade in the picture is taken over so much of it, either way.
_HALF_STEP_M = 0.5
#: What lies beyond the photo: the page's own wash, in BGR.
_BEYOND = (244, 242, 238)


def shown_m(record: PhotoRecord) -> float | None:
    """Return about how many metres of the blade a photo shows; None where that is not known."""
    along = None if record.view is None else _along(record, record.view, record.metre)
    if along is None:
        return None
    a, b = along
    return min(record.width_px, record.height_px) / float(np.linalg.norm(b - a))


def turned(
    picture: NDArray[np.uint8],
    record: PhotoRecord,
    metre: float,
    span_m: float,
    size_px: tuple[int, int],
) -> NDArray[np.uint8] | None:
    """Return the stretch of ``span_m`` about a metre, as (height, width, 3); None: not known.

    ``picture``: the photo, of any size; ``size_px``: width, which shows the span, and height.
    """
    along = None if record.view is None else _along(record, record.view, metre)
    if along is None:
        return None
    shrunk = picture.shape[1] / record.width_px
    width, height = size_px
    a, b = (end * shrunk for end in along)
    scale = width / span_m / float(np.linalg.norm(b - a))
    if scale < 1.0:
        # By areas first: a warp alone would pick single pixels.
        picture = np.asarray(
            cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8
        )
        a, b, scale = a * scale, b * scale, 1.0
    angle = math.atan2(b[1] - a[1], b[0] - a[0])
    cos, sin = scale * math.cos(angle), scale * math.sin(angle)
    turn = np.array([[cos, sin], [-sin, cos]])
    shift = np.array([width / 2, height / 2]) - turn @ ((a + b) / 2)
    matrix = np.column_stack([turn, shift])
    return np.asarray(
        cv2.warpAffine(
            picture, matrix, (width, height), flags=cv2.INTER_LINEAR, borderValue=_BEYOND
        ),
        np.uint8,
    )


def _along(record: PhotoRecord, view: View, metre: float) -> tuple[Float, Float] | None:
    """Return two pixels (2,) of the stored photo a metre of blade apart, the root's first."""
    blade = view.blade()
    if blade is None:
        return None
    ends = [
        [np.interp(m, blade.metre_m, blade.centre_w[:, axis]) for axis in range(3)]
        for m in (metre - _HALF_STEP_M, metre + _HALF_STEP_M)
    ]
    camera = view.camera()
    seen = (np.array(ends) - camera.position_w) @ camera.rotation_wc
    pixels, ahead = view.lens(record.width_px, record.height_px).pixels(seen)
    apart = float(np.linalg.norm(pixels[1] - pixels[0]))
    if not ahead.all() or not 1.0 < apart < math.inf:
        return None
    return pixels[0], pixels[1]
