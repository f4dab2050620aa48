"""Exposure by inverting the camera's response: ours, in the place of the paper's fixed step.

The camera is radiance x 2^EV -> tone curve -> grey. Knowing the curve, one frame tells by how many
EV it missed the target. Three rules make it fast without overshoot:

- reckon from the EV that produced the frame, never from the one last commanded: latency then only
  delays, it cannot make the loop ring;
- the curve is learned: it begins as sRGB and is corrected by every pair of frames of the same
  scene whose EV differ;
- a saturated mean only bounds the truth: jump far enough to get off the stop, then measure.

A steady trend of the light is carried on over the latency.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from config.inspection import Exposure
from perception.values import Float

#: Grey levels between which the curve's slope is learned apart.
KNOTS: Float = np.array([0.0, 8.0, 30.0, 70.0, 110.0, 150.0, 190.0, 225.0, 245.0, 255.0])
#: Share of an observed error of the curve that is taken over at once.
LEARNING = 0.4
#: Learned slopes stay within this factor of the nominal curve.
MAX_FACTOR = 3.0
#: A frame that differs more than this from the trend (EV) is a step of the light, not a trend.
STEP_EV = 0.3
MAX_RATE_EV_PER_S = 4.0
#: Trends are taken over about this time.
RATE_MEMORY_S = 0.4


class PredictiveExposure:
    """Inverts a learned response; see the module."""

    def __init__(
        self,
        settings: Exposure,
        *,
        min_ev: float = -3.0,
        max_ev: float = 3.0,
        lead_s: float = 0.15,
    ) -> None:
        """Start from the sRGB curve.

        ``lead_s``: from a frame to the first frame exposed with what it asked for.
        """
        self._settings = settings
        self._min_ev = min_ev
        self._max_ev = max_ev
        self._lead_s = lead_s
        self._widths_ev = np.diff(_srgb_ev(KNOTS))
        self._nominal_ev = self._widths_ev.copy()
        self._last: tuple[float, float, float, float] | None = None
        self._rate = 0.0
        self._steady = 0
        self._wanted_ev: float | None = None

    def update(self, mean_grey: float, clipped: float, ev_of_frame: float, stamp_s: float) -> float:
        """Return the EV wanted after one frame; see `perception.exposure.ExposureControl`."""
        if not all(map(math.isfinite, (mean_grey, clipped, ev_of_frame, stamp_s))):
            return self._wanted_ev if self._wanted_ev is not None else 0.0
        grey = min(max(mean_grey, 0.0), 255.0)
        self._learn(grey, clipped, ev_of_frame, stamp_s)
        light = self._ev_at(grey) - ev_of_frame
        self._follow_trend(light, clipped, stamp_s)
        self._last = (stamp_s, grey, clipped, ev_of_frame)

        missed = self._ev_at(self._settings.target_grey) - self._ev_at(grey)
        if clipped > 0.02 and grey > self._settings.target_grey:
            # The clipped share hides how bright it is; 1.2 EV lands a fully white disc mid-scale.
            missed -= 1.2 * min(clipped, 1.0)
        elif grey < KNOTS[1]:
            missed += 1.0 * (1.0 - grey / KNOTS[1])
        wanted = ev_of_frame + missed - self._rate * self._lead_s
        wanted = min(max(wanted, self._min_ev), self._max_ev)
        held = self._wanted_ev
        # Noise of the mean must not flip between two steps of the camera.
        in_range = self._settings.min_grey <= grey <= self._settings.max_grey
        if held is None or not in_range or abs(wanted - held) > 0.6 * self._settings.step_ev:
            held = wanted
        self._wanted_ev = held
        return held

    def grey_after(self, mean_grey: float, change_ev: float) -> float:
        """Return the grey that the learned curve expects after a change of EV."""
        greys = np.asarray(KNOTS)
        evs = np.concatenate([[0.0], np.cumsum(self._widths_ev)])
        return float(np.interp(self._ev_at(mean_grey) + change_ev, evs, greys))

    def _ev_at(self, grey: float) -> float:
        """Return the learned inverse response: EV above that of black."""
        evs = np.concatenate([[0.0], np.cumsum(self._widths_ev)])
        return float(np.interp(grey, KNOTS, evs))

    def _learn(self, grey: float, clipped: float, ev: float, stamp_s: float) -> None:
        """Correct the curve between the greys of two frames that differ in EV only."""
        if self._last is None:
            return
        then_s, before, clipped_before, ev_before = self._last
        change = ev - ev_before
        usable = abs(change) > 0.2 and 0 < stamp_s - then_s < 0.5
        usable &= max(clipped, clipped_before) < 0.02 and min(grey, before) > KNOTS[1]
        seen = self._ev_at(grey) - self._ev_at(before)
        # The light may have changed in between: a seen change of the wrong sign or far off tells
        # nothing about the curve.
        if not usable or seen * change <= 0 or not 0.4 < seen / change < 2.5:
            return
        low, high = min(grey, before), max(grey, before)
        for index, (left, right) in enumerate(itertools.pairwise(KNOTS)):
            share = max(0.0, min(high, right) - max(low, left)) / (right - left)
            factor = (change / seen) ** (LEARNING * share)
            nominal = self._nominal_ev[index]
            self._widths_ev[index] = np.clip(
                self._widths_ev[index] * factor, nominal / MAX_FACTOR, nominal * MAX_FACTOR
            )

    def _follow_trend(self, light: float, clipped: float, stamp_s: float) -> None:
        """Update the rate of the light (EV/s); a step or a saturated frame restarts it."""
        if self._last is None:
            return
        then_s, grey, clipped_before, ev = self._last
        passed = stamp_s - then_s
        if passed <= 0 or passed > 0.5 or max(clipped, clipped_before) > 0.2:
            self._rate, self._steady = 0.0, 0
            return
        change = light - (self._ev_at(grey) - ev)
        if abs(change - self._rate * passed) > STEP_EV:
            self._rate, self._steady = 0.0, 0
            return
        self._steady += 1
        share = min(1.0, passed / RATE_MEMORY_S)
        rate = self._rate + share * (change / passed - self._rate)
        self._rate = min(max(rate, -MAX_RATE_EV_PER_S), MAX_RATE_EV_PER_S)


def _srgb_ev(grey: Float) -> Float:
    """Return EV above the darkest level of grey levels under the sRGB curve."""
    level = np.maximum(grey, 1.0) / 255.0
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.log2(linear / linear[0]), np.float64)
