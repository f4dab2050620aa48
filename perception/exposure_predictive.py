"""Exposure by inverting the camera's response: ours, in the place of the paper's fixed step.

The camera is light x 2^EV -> tone curve -> grey. Knowing the curve, one frame tells by how many
EV it missed the target:

- reckon from the EV that produced the frame, never from the one last commanded: latency then only
  delays, it cannot make the loop ring. Which EV that was is learned (`exposure_timeline`);
- the curve is learned (`exposure_response`);
- a saturated mean only bounds the light: its darkest pixels say more, and where they are white too
  jump far enough to get off the stop, then measure;
- its ends are looked at once, while no photo is near (`exposure_sweep`);
- a ramp of the light is carried on over the latency (`exposure_trend`), and so is what the
  camera's own automatic is about to do (`exposure_automatic`);
- the wish moves only when another step of the camera is clearly nearer.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

from config.inspection import Exposure
from perception.exposure_automatic import Automatic
from perception.exposure_control import ExposureControl
from perception.exposure_limits import EvSteps
from perception.exposure_response import BRIGHT, DARK, Histogram, Response
from perception.exposure_sweep import Sweep
from perception.exposure_timeline import EvTimeline, Span
from perception.exposure_trend import Trend
from perception.metering import Metered

#: From this share of clipped pixels on the mean is no measure any more.
CLIPPED = 0.03
#: A picture all white is this much (EV) brighter than white at least, one all black darker.
#: More would land darker than the range when it was only just white.
BEYOND_WHITE_EV = 0.5
BEYOND_BLACK_EV = 1.5
#: The wish moves when another step is nearer by this share of a step.
HYSTERESIS = 0.1
#: Share by which the automatic's pace may be misjudged: near white the curve is known least.
UNSURE_PACE = 0.3
#: A change of the light or the exposure within a frame beyond this (EV) is no part of a ramp.
STEP_EV = 0.4
#: Frames farther apart than this (s) do not show one light.
_TOGETHER_S = 0.35
_STEADY_EV = 0.12


@dataclass(frozen=True, slots=True)
class _Seen:
    stamp_s: float
    metered: Metered
    level_ev: float
    span: Span
    """Of the level: where it is only bounded, the bounds."""
    ev: float
    certain: bool
    histogram: Histogram | None

    @property
    def measured(self) -> bool:
        """Whether the level is more than a bound."""
        return self.span[0] == self.span[1]


class PredictiveExposure(ExposureControl):
    """Inverts a learned response; see the module."""

    def __init__(self, settings: Exposure, steps: EvSteps, *, automatic: bool = False) -> None:
        """Start from the sRGB curve and an unknown latency.

        ``automatic``: EV biases the camera's own automatic instead of being absolute.
        """
        super().__init__(steps, settings.target_grey)
        self.response = Response()
        self.timeline = EvTimeline()
        self.trend = Trend()
        self.automatic = Automatic(present=automatic)
        self.sweep = Sweep()
        self._frames: deque[_Seen] = deque(maxlen=4)
        self._held_ev: float | None = None
        self._asked_ev: float | None = None
        self._darkest_ev: float | None = None
        self._residual_ev = 0.0

    def confirmed(self, ev: float, stamp_s: float) -> None:
        """Note an EV that the camera confirmed; see `ExposureControl`."""
        if math.isfinite(ev) and math.isfinite(stamp_s):
            self.timeline.confirmed(ev, stamp_s)
            if self._held_ev is None:
                self._held_ev = self._asked_ev = ev

    def update(
        self,
        metered: Metered,
        stamp_s: float,
        histogram: Histogram | None = None,
        *,
        spare: bool = False,
    ) -> float:
        """Return the EV wanted after one frame; see `ExposureControl`."""
        held = self._held_ev if self._held_ev is not None else self._steps.nearest(0.0)
        newest_s = self._frames[-1].stamp_s if self._frames else -math.inf
        figures = (metered.mean_grey, metered.clipped, metered.low_grey, stamp_s)
        if not all(map(math.isfinite, figures)) or stamp_s <= newest_s:
            return held
        level_ev, span = self._level(metered)
        period_s = min(max(stamp_s - newest_s, 0.02), 0.2)
        expected = self._expected_light(stamp_s)
        # A bound cannot tell whether an answer shows already: then it is not given twice.
        slack_s = (0.6 if span[0] == span[1] else 1.3) * period_s
        found = self.timeline.ev_of(stamp_s, span, expected, slack_s)
        if found is None:
            return held
        seen = _Seen(stamp_s, metered, level_ev, span, *found, histogram)
        last = self._frames[-1] if self._frames else None
        change_ev = None
        if last is not None and last.measured and seen.measured:
            drift_ev = self._drift(stamp_s - last.stamp_s)
            change_ev = level_ev - last.level_ev - drift_ev
        self.timeline.vote(stamp_s, change_ev)
        self._follow(seen)
        self._frames.append(seen)
        self._learn()
        lead_s = self.timeline.lead_s(period_s)
        ahead = self.trend.ahead(lead_s, self._doubt()) + self.automatic.ahead(lead_s)
        target_ev = self.response.ev_at(self._target_grey)
        wanted_ev = target_ev - (self._frames[-1].level_ev - seen.ev) - ahead
        settled = found[1] and abs(found[0] - held) < 0.02
        wanted_ev += self.sweep.offset_ev(stamp_s, spare=spare, settled=settled)
        self._hold(wanted_ev, stamp_s)
        return self._held_ev if self._held_ev is not None else held

    def _level(self, metered: Metered) -> tuple[float, Span]:
        """Return the EV of the blade's grey as taken, and what it may be."""
        grey = min(max(metered.mean_grey, 0.0), 255.0)
        mean_ev = self.response.ev_at(grey)
        if metered.clipped > CLIPPED and grey > self._target_grey:
            if metered.low_grey < BRIGHT and self._darkest_ev is not None:
                # The darkest pixels are not clipped: how far they lie below the mean is known.
                level = max(self.response.ev_at(metered.low_grey) - self._darkest_ev, mean_ev)
                return level, (level, level) if metered.clipped < 0.5 else (mean_ev, math.inf)
            # The curve's own end is the least known of it: reckoned from just below.
            white_ev = min(mean_ev, self.response.ev_at(BRIGHT))
            return white_ev + BEYOND_WHITE_EV * min(metered.clipped, 1.0), (white_ev, math.inf)
        if grey > BRIGHT:
            # Not clipped, yet where the curve is flattest and never learned.
            return mean_ev, (self.response.ev_at(BRIGHT), math.inf)
        if grey < DARK:
            return mean_ev - BEYOND_BLACK_EV * (1.0 - grey / DARK), (-math.inf, mean_ev)
        if metered.clipped < 0.002 and metered.low_grey > DARK:
            below = self.response.ev_at(metered.low_grey) - mean_ev
            before = below if self._darkest_ev is None else self._darkest_ev
            self._darkest_ev = before + 0.1 * (below - before)
        return mean_ev, (mean_ev, mean_ev)

    def _expected_light(self, stamp_s: float) -> Span | None:
        if not self._frames or stamp_s - self._frames[-1].stamp_s > _TOGETHER_S:
            return None
        last = self._frames[-1]
        more = self._drift(stamp_s - last.stamp_s) - last.ev
        return last.span[0] + more, last.span[1] + more

    def _drift(self, passed_s: float) -> float:
        """Return by how much (EV) light and automatic are expected to change in a time."""
        return self.automatic.ahead(passed_s) + self.trend.rate(self._doubt()) * passed_s

    def _doubt(self) -> float:
        """Return how much (EV/s) of a rate may be the automatic's: its pace is known roughly."""
        return UNSURE_PACE * abs(self.automatic.pace())

    def _follow(self, seen: _Seen) -> None:
        """Feed the trend with what the automatic does not explain, and the automatic."""
        light = seen.level_ev - seen.ev
        last = self._frames[-1] if self._frames else None
        if last is None or not (seen.measured and last.measured):
            self.trend.reset()
        else:
            passed_s = seen.stamp_s - last.stamp_s
            change = light - (last.level_ev - last.ev) - self.automatic.ahead(passed_s)
            if abs(change) > STEP_EV or abs(seen.ev - last.ev) > STEP_EV:
                # A step of the light, or of the curve's error: no ramp. The trend goes on.
                change = self.trend.rate(self._doubt()) * passed_s
            self._residual_ev += change
            self.trend.update(seen.stamp_s, self._residual_ev)
        if seen.histogram is not None:
            whole = self.response.light_of(seen.histogram) - seen.ev
            self.automatic.update(whole, seen.stamp_s)

    def _learn(self) -> None:
        """Correct the curve by a change of EV, one frame later: did the light stand still?"""
        if len(self._frames) < 3:
            return
        before, after, now = list(self._frames)[-3:]
        change_ev = after.ev - before.ev
        if before.histogram is None or after.histogram is None:
            return
        together = now.stamp_s - before.stamp_s < 2 * _TOGETHER_S
        if not together or abs(change_ev) < 0.02 or abs(now.ev - after.ev) > 0.02:
            return
        if abs(now.level_ev - after.level_ev) > _STEADY_EV and now.measured and after.measured:
            return
        steady = (
            len(self._frames) >= 4
            and abs(self._frames[-4].ev - before.ev) < 0.02
            and abs(self._frames[-4].level_ev - before.level_ev) < _STEADY_EV
        )
        sure = after.certain and before.certain and now.certain
        weight = (1.0 if steady else 0.3) * (1.0 if sure else 0.5)
        whole_ev = self.response.light_of(after.histogram)
        if self.response.learn(before.histogram, after.histogram, change_ev, weight):
            self.automatic.recalibrate(self.response.light_of(after.histogram) - whole_ev)
            self._frames = deque((self._seen_anew(one) for one in self._frames), maxlen=4)

    def _seen_anew(self, seen: _Seen) -> _Seen:
        level_ev, span = self._level(seen.metered)
        return replace(seen, level_ev=level_ev, span=span)

    def _hold(self, wanted_ev: float, stamp_s: float) -> None:
        """Move the wish when another step is clearly nearer, and note what is asked for."""
        nearest = self._steps.nearest(wanted_ev)
        held = self._held_ev
        step = self._steps.width_at(wanted_ev)
        self._at_limit = abs(nearest - wanted_ev) > 0.75 * step
        if held is None or abs(wanted_ev - held) > abs(wanted_ev - nearest) + HYSTERESIS * step:
            held = nearest
        self._held_ev = held
        if self._asked_ev is None or abs(held - self._asked_ev) > 1e-6:
            self._asked_ev = held
            self.timeline.asked(held, stamp_s)
