"""Which side of its tower the rotor hangs on, by all looks of late.

A look from below, or past a tower of which little is seen, now and then explains by a plane what is
none. It is told by the others: the side is believed where twice as many looks name it as name any
other, and unknown where they contradict each other.
"""

from __future__ import annotations

import math
from collections import deque

from perception.hub_prior import SurveyResult

#: Looks whose sides differ by less name the same one.
SAME_RAD = math.radians(30.0)
#: Twice as many must name a side as name others.
MAJORITY = 2.0
KEPT = 200


class SideVotes:
    """Looks that named a side; the older ones fade out."""

    def __init__(self, kept_s: float) -> None:
        self._kept_s = kept_s
        self._looks: deque[SurveyResult] = deque(maxlen=KEPT)

    def add(self, look: SurveyResult) -> None:
        """Take in a look that names a side."""
        self._looks.append(look)

    def believed(self, stamp_s: float) -> SurveyResult | None:
        """Return the newest look of the side that is believed at a time, None: none is."""
        looks = [look for look in self._looks if stamp_s - look.stamp_s <= self._kept_s]
        best: list[SurveyResult] = []
        for look in looks:
            same = [other for other in looks if _same(look, other)]
            if len(same) > len(best):
                best = same
        if not best or len(best) < MAJORITY * (len(looks) - len(best)):
            return None
        return best[-1]


def _same(one: SurveyResult, other: SurveyResult) -> bool:
    if one.normal_w is None or other.normal_w is None:
        return False
    return float(one.normal_w @ other.normal_w) > math.cos(SAME_RAD)
