"""Which EV a frame was exposed with: settings are confirmed early and take effect late.

How late is learned: every latency of a range is a hypothesis, and each change of EV is a vote. The
right hypothesis sees the light stand still while the grey jumps; a wrong one sees the light jump
and jump back. Where hypotheses that are still good disagree about a frame, the one under which the
light changes least is taken: before anything is learned that already separates old from new.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.values import Float

#: From the confirmation of a setting to the first exposure with it, in seconds. Negative: the
#: confirmation comes after the first such frame.
LATENCIES_S: Float = np.linspace(-0.2, 0.7, 91, dtype=np.float64)
#: Where a latency is looked for before anything is known.
LIKELY_S = (-0.05, 0.5)
#: Hypotheses whose cost is within this of the best, or half way to the usual, are still good.
GOOD = 0.2
#: What a latency outside `LIKELY_S` costs from the start; evidence outweighs it.
_UNLIKELY = 0.35
#: What one change of EV leaves of the evidence before it.
_KEPT = 0.85
_MOST_COST = 1.0
#: A wish that was not confirmed after this was refused or overtaken.
_GIVEN_UP_S = 1.5
#: A change of light (EV) that another EV would explain better by so much is put down to the EV.
_BETTER_EV = 0.15
#: Settings older than this are in force whatever the latency.
_OLD_S = 1.5


#: Lowest and highest value that may be, in EV; equal where it is measured.
Span = tuple[float, float]


@dataclass(slots=True)
class _Setting:
    ev: float
    stamp_s: float
    """When it was confirmed, or is expected to be."""
    asked_s: float
    confirmed: bool


class EvTimeline:
    """Settings in order of time, and the latency learned from them."""

    def __init__(self) -> None:
        """Start knowing nothing."""
        self._settings: deque[_Setting] = deque(maxlen=32)
        self._costs: Float = np.where(
            (LIKELY_S[0] - 1e-9 > LATENCIES_S) | (LIKELY_S[1] + 1e-9 < LATENCIES_S), _UNLIKELY, 0.0
        )
        self._confirm_s = 0.05
        self._last: tuple[float, Float] | None = None
        self._judged: tuple[float, NDArray[np.intp]] | None = None
        """Hypotheses that are still good, and the confirmation time they were judged with."""

    @property
    def known(self) -> bool:
        """Has the camera said what it is set to?"""
        return any(setting.confirmed for setting in self._settings)

    @property
    def latency_s(self) -> float:
        """Middle of the hypotheses that are still good."""
        good = LATENCIES_S[self._good()]
        # They ascend: the middle one, or the mean of the two.
        return float(good[(len(good) - 1) // 2] + good[len(good) // 2]) / 2

    def lead_s(self, period_s: float) -> float:
        """Return the time from a frame to the first frame that its answer exposes."""
        late_s = max(self._confirm_s + self.latency_s, 0.0)
        return max(1.0, float(np.ceil(late_s / period_s - 0.05))) * period_s

    def asked(self, ev: float, stamp_s: float) -> None:
        """Note that an EV was asked for after the frame of ``stamp_s``."""
        self._settings.append(_Setting(ev, stamp_s + self._confirm_s, stamp_s, confirmed=False))

    def confirmed(self, ev: float, stamp_s: float) -> None:
        """Note that the camera confirmed an EV at a time; a known confirmation changes nothing."""
        if any(one.confirmed and one.stamp_s >= stamp_s for one in self._settings):
            return
        waiting = [one for one in self._settings if not one.confirmed]
        meant = [one for one in waiting if one.asked_s <= stamp_s and abs(one.ev - ev) < 0.02]
        if meant:
            took_s = min(max(stamp_s - meant[-1].asked_s, 0.0), 1.0)
            self._confirm_s += 0.3 * (took_s - self._confirm_s)
        # Wishes from before this one were overtaken by it.
        limit_s = meant[-1].asked_s if meant else float("-inf")
        kept = [one for one in self._settings if one.confirmed or one.asked_s > limit_s]
        kept.append(_Setting(ev, stamp_s, stamp_s, confirmed=True))
        self._settings = deque(sorted(kept, key=lambda one: one.stamp_s), maxlen=32)

    def ev_of(
        self, stamp_s: float, level: Span, expected_light: Span | None, slack_s: float
    ) -> tuple[float, bool] | None:
        """Return the EV of a frame and whether it is certain; None while nothing is confirmed.

        ``level``: EV of the blade's grey; ``expected_light``: the light (level minus EV) that the
        frames before let expect; both as spans, for a clipped frame only bounds them.
        ``slack_s``: how much a latency varies.
        """
        self._forget(stamp_s)
        if not self.known:
            return None
        evs = self._evs_by_latency(stamp_s)
        good = self._good()
        likely = evs[good]
        usual = float(evs[int(np.argmin(np.abs(LATENCIES_S - self.latency_s)))])
        certain = bool(np.ptp(likely) < 0.02)
        spread = LATENCIES_S[good]
        near = (spread[0] - slack_s <= LATENCIES_S) & (spread[-1] + slack_s >= LATENCIES_S)
        choices = np.unique(np.round(evs[near], 3))
        if expected_light is None or len(choices) == 1:
            return usual, certain
        changes = np.array([_gap(level, float(ev), expected_light) for ev in choices])
        best = int(np.argmin(changes))
        # What the learned latency says stands unless another EV explains the frame clearly better;
        # among hypotheses equally good the older setting is the careful answer, and where the
        # level, or the light before, is only a bound all are equally good.
        measured = level[0] == level[1] and expected_light[0] == expected_light[1]
        start = usual if certain and measured else float(evs[near][-1])
        standing = _gap(level, start, expected_light)
        # A large jump that the standing EV leaves and another explains: the latency varied.
        if changes[best] < standing - _BETTER_EV and (
            not certain or changes[best] < 0.3 * standing
        ):
            return float(choices[best]), False
        return start, certain

    def vote(self, stamp_s: float, change_ev: float | None) -> None:
        """Let a frame judge the hypotheses.

        ``change_ev``: of the blade's level since the frame before, less what the light was expected
        to do; None where either is a bound.
        """
        if not self.known:
            return
        evs = self._evs_by_latency(stamp_s)
        if self._last is not None and change_ev is not None and stamp_s - self._last[0] < 0.5:
            changes = evs - self._last[1]
            if float(np.ptp(changes)) > 0.1:
                # Relative, and squared: a curve that is yet wrong makes the right change look
                # too large or too small, a wrong latency one where there is none.
                larger = np.maximum(np.abs(changes), abs(change_ev)) + 1e-6
                off = np.minimum(np.abs(change_ev - changes) / larger, 1.0)
                weight = self._weight(stamp_s)
                costs = off**2 * np.minimum(larger, _MOST_COST)
                # One change keeps frames voting all through the range of latencies.
                share = (stamp_s - self._last[0]) / float(LATENCIES_S[-1] - LATENCIES_S[0])
                self._costs = _KEPT ** (weight * share) * self._costs + weight * costs
                self._costs -= self._costs.min()
                self._judged = None
        self._last = (stamp_s, evs)

    def _weight(self, stamp_s: float) -> float:
        """Return what a frame's vote counts: in a series of changes one is taken for another."""
        since_s = stamp_s - float(LATENCIES_S[-1])
        return 1.0 / max(1, sum(since_s < one.stamp_s <= stamp_s for one in self._settings)) ** 2

    def _good(self) -> NDArray[np.intp]:
        if self._judged is not None and self._judged[0] == self._confirm_s:
            return self._judged[1]
        # Nothing shows before it was asked for.
        possible = LATENCIES_S + self._confirm_s >= -0.01
        costs = np.where(possible, self._costs, np.inf)
        best, usual = float(costs.min()), float(np.median(self._costs[possible]))
        # Where a latency varies across a frame, two neighbours share the votes.
        good = np.flatnonzero(costs <= best + max(GOOD, 0.5 * (usual - best)))
        self._judged = self._confirm_s, good
        return good

    def _evs_by_latency(self, stamp_s: float) -> Float:
        """Return the EV in force at a frame under every hypothesis."""
        stamps = np.array([one.stamp_s for one in self._settings])
        evs = np.array([one.ev for one in self._settings])
        index = np.searchsorted(stamps, stamp_s - LATENCIES_S + 1e-6, side="right") - 1
        return np.asarray(evs[np.maximum(index, 0)], np.float64)

    def _forget(self, now_s: float) -> None:
        """Drop wishes that were never confirmed, and settings long out of force."""
        kept = [one for one in self._settings if one.confirmed or now_s - one.asked_s < _GIVEN_UP_S]
        while len(kept) > 1 and now_s - kept[1].stamp_s > _OLD_S:
            kept.pop(0)
        self._settings = deque(kept, maxlen=32)


def _gap(level: Span, ev: float, expected: Span) -> float:
    """Return by how much the light must have changed for a level at an EV."""
    return max(0.0, expected[0] - (level[1] - ev), (level[0] - ev) - expected[1])
