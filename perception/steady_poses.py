"""Poses that hang together over seconds, where the receiver's own positions are noisy.

Without RTK the position that an autopilot tells jitters by decimetres within the seconds in which
a cloud is gathered, while its velocity, which the receiver measures by the Doppler shift, is good
to centimetres per second. The velocity carries the position on, and the positions told pull it
back slowly (a complementary filter): scans so placed fit together, and still lie where the
autopilot believes that they lie, on the mean of some seconds.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from perception.values import Float, Pose

#: The positions told pull for about so long.
PULL_S = 5.0
#: A position whose fast part is larger (standard deviation) blurs what is joined over seconds.
NOISY_M = 0.1
#: A gap in the poses, or a step of the frame, begins anew.
MOST_GAP_S, MOST_APART_M = 1.0, 3.0
KEPT = 120


class SteadyPoses:
    """Follows the poses of an autopilot; `poses` are the newest of them, steadied."""

    def __init__(self) -> None:
        self.poses: deque[Pose] = deque(maxlen=KEPT)
        self._moved_w: deque[Float] = deque(maxlen=KEPT)
        """(3,) of each: steadied position less the one told."""

    def follow(self, told: Iterable[Pose]) -> None:
        """Take in the poses that are newer than those before, sorted by stamp."""
        newest_s = self.poses[-1].stamp_s if self.poses else float("-inf")
        for pose in told:
            if pose.stamp_s > newest_s:
                self._take(pose)

    def moved_w(self, stamp_s: float) -> Float:
        """Return what (3,) is to be added to a place told about a moment, among steadied ones."""
        if not self.poses:
            return np.zeros(3)
        apart_s = [abs(pose.stamp_s - stamp_s) for pose in self.poses]
        return self._moved_w[int(np.argmin(apart_s))]

    def _take(self, pose: Pose) -> None:
        if not self.poses:
            self._begin(pose)
            return
        last = self.poses[-1]
        gap_s = pose.stamp_s - last.stamp_s
        carried_w = last.position_w + 0.5 * gap_s * (last.velocity_w + pose.velocity_w)
        apart_w = pose.position_w - carried_w
        if gap_s > MOST_GAP_S or float(np.linalg.norm(apart_w)) > MOST_APART_M:
            self._begin(pose)
            return
        place_w = carried_w + min(gap_s / PULL_S, 1.0) * apart_w
        self.poses.append(replace(pose, position_w=place_w))
        self._moved_w.append(place_w - pose.position_w)

    def _begin(self, pose: Pose) -> None:
        self.poses.clear()
        self._moved_w.clear()
        self.poses.append(pose)
        self._moved_w.append(np.zeros(3))
