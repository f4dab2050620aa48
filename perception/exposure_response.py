"""The camera's response, learned in flight from its own changes of exposure.

A picture and the next one, exposed differently by a known EV, show the same scene: the grey that
had rank q before has rank q after (Grossberg and Nayar 2003, brightness transfer by histograms).
Every rank is one equation E(after) - E(before) = change of EV on the curve E, all over the tonal
range at once, so that a single change tells most of the curve. Ranks need no registration: the
drone may move between the two pictures.

The curve begins as sRGB with some contrast added and gives way as far as the evidence reaches.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from perception.values import Float

Histogram = NDArray[np.int64]

#: Grey levels between which the curve is straight.
KNOTS: Float = np.array(
    [0.5, 3.0, 8.0, 16.0, 30.0, 50.0, 75.0, 100.0, 130.0, 160.0, 188.0, 212.0, 232.0, 246.0, 255.0]
)
#: Grey that has EV 0: near the target, so that what is learned elsewhere does not move it.
ANCHOR = 135.0
#: Cameras add contrast to sRGB: by so much flatter at the white end, steeper in the shadows.
SHOULDER, TOE = 0.6, 0.25
#: Greys nearer to the ends than this are crushed or clipped and say nothing.
DARK, BRIGHT = 6.0, 247.0
#: Changes smaller than this (EV) drown in what else changes between two pictures.
LEAST_CHANGE_EV = 0.25
#: Learned slopes stay within this factor of the nominal curve.
MAX_FACTOR = 4.0
#: Standard deviations: of a slope's ratio to sRGB, of its jump to the next, of one rank (EV).
_PRIOR, _SMOOTH, _RANK_EV = 0.6, 0.2, 0.08
#: Weight that old evidence keeps when new one comes.
_KEPT = 0.97
_RANKS: Float = np.linspace(0.02, 0.98, 33, dtype=np.float64)
#: A rank whose grey spreads by this much over its neighbours lies between two things seen.
_GAP_GREY = 6.0


class Response:
    """Inverse response E: grey to EV, learned."""

    def __init__(self) -> None:
        """Start from the sRGB curve with some contrast added."""
        middle = 0.5 * (KNOTS[1:] + KNOTS[:-1])
        bent = np.interp(middle, (70.0, ANCHOR, 255.0), (1.0 - TOE, 1.0, 1.0 + SHOULDER))
        nominal: Float = np.diff(_srgb_ev(KNOTS)).astype(np.float64) * bent
        self._nominal_ev = nominal
        self._widths_ev: Float = nominal.copy()
        size = len(nominal)
        slopes = np.diag(1.0 / nominal)
        jumps = np.diff(slopes, axis=0)
        self._prior = slopes.T @ slopes / _PRIOR**2 + jumps.T @ jumps / _SMOOTH**2
        self._prior_side = slopes.T @ np.ones(size) / _PRIOR**2
        self._seen: Float = np.zeros((size, size))
        self._seen_side: Float = np.zeros(size)
        self._evs: Float = _anchored(nominal)

    def ev_at(self, grey: float) -> float:
        """Return the light of a grey 0-255 in EV above that of `ANCHOR`."""
        return float(np.interp(grey, KNOTS, self._evs))

    def grey_at(self, ev: float) -> float:
        """Return the grey of a light in EV above that of `ANCHOR`."""
        return float(np.interp(ev, self._evs, KNOTS))

    def light_of(self, histogram: Histogram) -> float:
        """Return the mean light of a picture, as far as it is not clipped, in EV above `ANCHOR`."""
        total = float(histogram.sum())
        linear = np.exp2(np.interp(np.arange(256.0), KNOTS, self._evs))
        return float(np.log2(max(float(histogram @ linear) / max(total, 1.0), 1e-6)))

    def learn(
        self, before: Histogram, after: Histogram, change_ev: float, weight: float = 1.0
    ) -> bool:
        """Correct the curve by two pictures of one scene; return whether they could be used.

        ``before``, ``after``: (256,) counts of the whole pictures; ``change_ev``: EV of the second
        minus that of the first.
        """
        if abs(change_ev) < LEAST_CHANGE_EV or not before.any() or not after.any():
            return False
        low, low_gap = _greys_at_ranks(before)
        high, high_gap = _greys_at_ranks(after)
        usable = (np.minimum(low, high) > DARK) & (np.maximum(low, high) < BRIGHT)
        if int(usable.sum()) < 3:
            return False
        rows = (_cover(high) - _cover(low))[usable]
        seen_ev = rows @ self._widths_ev
        ratio = float(np.median(seen_ev)) / change_ev
        if not 0.3 < ratio < 3.0:
            return False  # the light changed, not the exposure alone
        gap = np.maximum(low_gap, high_gap)[usable] / _GAP_GREY
        off = (seen_ev - change_ev * max(ratio, 0.5)) / (0.5 * abs(change_ev))
        weights = weight / ((1.0 + gap**2) * (1.0 + off**2) * _RANK_EV**2)
        self._seen = _KEPT * self._seen + (rows * weights[:, None]).T @ rows
        self._seen_side = _KEPT * self._seen_side + change_ev * (rows.T @ weights)
        self._solve()
        return True

    def _solve(self) -> None:
        widths = np.linalg.solve(self._prior + self._seen, self._prior_side + self._seen_side)
        self._widths_ev = np.clip(
            widths, self._nominal_ev / MAX_FACTOR, self._nominal_ev * MAX_FACTOR
        )
        self._evs = _anchored(self._widths_ev)


def _anchored(widths_ev: Float) -> Float:
    """Return the EVs of the knots above that of `ANCHOR`, which corrections leave where it is."""
    evs = np.concatenate([[0.0], np.cumsum(widths_ev)])
    return np.asarray(evs - np.interp(ANCHOR, KNOTS, evs), np.float64)


def _cover(grey: Float) -> Float:
    """Return (N, K) shares of each interval of the knots that lie below N greys."""
    left, right = KNOTS[:-1], KNOTS[1:]
    return np.asarray(np.clip((grey[:, None] - left) / (right - left), 0.0, 1.0), np.float64)


def _greys_at_ranks(histogram: Histogram) -> tuple[Float, Float]:
    """Return the greys of the ranks, and how far they spread over 4 % of the pixels."""
    shares = np.cumsum(histogram) / histogram.sum()
    # A tiny slope keeps the interpolation defined where no pixel has a grey.
    shares = shares + np.arange(256) * 1e-9
    at = np.interp([_RANKS - 0.02, _RANKS, _RANKS + 0.02], shares, np.arange(256.0))
    return np.asarray(at[1]), np.asarray(at[2] - at[0])


def _srgb_ev(grey: Float) -> Float:
    """Return log2 of the light of grey levels under the sRGB curve."""
    level = grey / 255.0
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.log2(linear), np.float64)
