"""How much brighter or darker a camera's stills are than its live picture at the same moment.

Most cameras expose both alike. Where the stills of late stand apart from the live pictures of
their moments, and all by about as much, the live picture is exposed that much aside, so that the
stills come out right. Where they differ now one way and now another nothing can be done about it:
such photos are marked, and taken once more within bounds (`mission/records/second_shot.py`).

Where the last few stills of a pass are all out by much and alike, the live picture is metered on
something else than the blade that they show, ground beside it or its one lit face: then they are
gone by for as long as they are recent, whatever the camera's tone.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from statistics import median

from mission.flight.command import SensingTask
from mission.flight.observation import Observation, PhotoResult

#: A live picture belongs to a still that was taken within this time of it.
NEAR_S = 0.15
#: Live pictures are remembered until the still was fetched and judged.
REMEMBERED = 900
#: So many stills, of the last few, must agree to this (grey, from their median).
#: A camera's tone is the same all along: stills of a whole pass that stand apart otherwise than
#: those before them show another part of the blade than the live picture was metered on.
LEAST_STILLS, LAST_STILLS, AGREE_GREY = 6, 40, 6.0
#: So many stills in a row, taken within this time of now, are gone by where they all stand to one
#: side of the live picture, by the least of this (grey) each, and by as much in the middle.
RECENT_STILLS, RECENT_S, LEAST_EACH, RECENT_GREY, RECENT_AGREE = 3, 14.0, 8.0, 16.0, 35.0
#: Less than this apart (grey) is as good as alike; more than that is no tone curve's doing.
LEAST_GREY, MOST_GREY = 10.0, 60.0
#: A figure that moves by less is not told anew.
SAME_GREY = 3.0


class StillOffset:
    """Learns the offset from photos as they are judged."""

    def __init__(self) -> None:
        self._live: deque[tuple[float, float]] = deque(maxlen=REMEMBERED)
        self._apart: deque[float] = deque(maxlen=LAST_STILLS)
        self._recent: deque[tuple[float, float]] = deque(maxlen=RECENT_STILLS)
        self._tone = 0.0
        self.grey = 0.0
        """Stills less live picture; 0 while they are alike, or nothing is known."""

    @property
    def words(self) -> str:
        """Say it, for the log."""
        if self.grey == 0.0:
            return "stills are exposed as the live picture is"
        than = "brighter" if self.grey > 0 else "darker"
        return f"stills are {abs(self.grey):.0f} grey {than} than the live picture: exposed for it"

    def step(self, observation: Observation) -> bool:
        """Take in a tick: the newest metering, and photos judged since; return whether it is news.

        Not news is a figure that moves a little.
        """
        before = self.grey
        exposure = observation.exposure
        if exposure is not None and (not self._live or exposure.stamp_s > self._live[-1][0]):
            self._live.append((exposure.stamp_s, exposure.mean_grey))
        for photo in observation.photos:
            self._judged(photo)
        self.grey = self._of_this_pass(observation.now_s)
        return (before == 0.0) != (self.grey == 0.0)

    def told(self, task: SensingTask) -> SensingTask:
        """Return a task with what perception has to know of the stills."""
        return task if self.grey == 0.0 else replace(task, still_offset_grey=self.grey)

    def _judged(self, photo: PhotoResult) -> None:
        if photo.stamp_s is None or photo.mean_grey is None or not self._live:
            return
        taken_s = photo.stamp_s
        stamp_s, grey = min(self._live, key=lambda one: abs(one[0] - taken_s))
        if abs(stamp_s - taken_s) > NEAR_S:
            return
        self._apart.append(photo.mean_grey - grey)
        self._recent.append((taken_s, photo.mean_grey - grey))
        middle = median(self._apart)
        alike = median(abs(one - middle) for one in self._apart) <= AGREE_GREY
        if len(self._apart) < LEAST_STILLS or not alike or abs(middle) < LEAST_GREY:
            self._tone = 0.0
        elif abs(middle - self._tone) > SAME_GREY:
            self._tone = min(max(round(middle, 1), -MOST_GREY), MOST_GREY)

    def _of_this_pass(self, now_s: float) -> float:
        """Return what the newest stills say, where they say it clearly; else the camera's tone."""
        apart = [grey for taken_s, grey in self._recent if now_s - taken_s < RECENT_S]
        beyond = [grey - self._tone for grey in apart]
        if len(apart) < RECENT_STILLS or max(apart) - min(apart) > RECENT_AGREE:
            return self._tone
        aside = min(beyond) >= LEAST_EACH or max(beyond) <= -LEAST_EACH
        if not aside or abs(median(beyond)) < RECENT_GREY:
            return self._tone
        return min(max(round(median(apart)), -MOST_GREY), MOST_GREY)
