"""Where in the live picture the exposure was metered, for those who watch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mission.remote.messages import MeteringMessage

#: Corners of the outline that are told; it is smooth.
_CORNERS = 24


def metering_shown(
    stamp_s: float,
    size: tuple[int, int],
    centre_px: NDArray[np.float64] | None,
    radius_px: float,
    outline_px: NDArray[np.float64] | None,
) -> MeteringMessage | None:
    """Return what was metered as shares of the picture's width; None: nothing that can be shown.

    ``size``: width and height of the picture. The metered area is the disc, and of it what lies
    within ``outline_px`` (M, 2) where that is known.
    """
    width, height = size
    if centre_px is None or not np.isfinite(centre_px).all():
        return None
    outline: tuple[tuple[float, float], ...] = ()
    if outline_px is not None and np.isfinite(outline_px).all():
        corners = outline_px[:: max(1, len(outline_px) // _CORNERS)]
        corners = np.clip(corners, (-width, -height), (2 * width, 2 * height)) / width
        outline = tuple((round(float(x), 4), round(float(y), 4)) for x, y in corners)
    return MeteringMessage(
        stamp_s=stamp_s,
        aspect=round(height / width, 4),
        centre=(round(float(centre_px[0]) / width, 4), round(float(centre_px[1]) / width, 4)),
        radius=round(radius_px / width, 4),
        outline=outline,
    )
