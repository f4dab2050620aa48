"""Photos along a leg: when each is due, what it waits for, and what became of it."""

from __future__ import annotations

import math

from mission.flight.command import GimbalAim, PhotoCommand
from mission.flight.flight import Flight
from mission.flight.ledger import Photo, PhotoStatus
from mission.flight.passes import Leg
from perception.values import Float

#: A photo is due this much before its metre: half of what is flown in a tick, and a little.
DUE_M = 0.12
#: Past its metre by this much the vehicle stands until the photo is taken.
STAND_M = 0.4
AIM_WAIT_S = 3.0
CONFIRM_S = 4.0


class Shooter:
    """Decides the photos of one leg."""

    def __init__(self, leg: Leg, photos: tuple[float, ...]) -> None:
        self._leg = leg
        self._left = list(photos)
        self._sign = 1.0 if len(photos) < 2 or photos[-1] >= photos[0] else -1.0
        self._waiting_s: float | None = None
        self._taken_s = -math.inf
        self._asked: list[Photo] = []
        self._again: set[float] = set()

    @property
    def left(self) -> tuple[float, ...]:
        """Metres of the photos that are still to be taken."""
        return tuple(self._left)

    def step(
        self, flight: Flight, metre: float, distance_m: float, aim: GimbalAim, foot_w: Float
    ) -> tuple[PhotoCommand | None, float]:
        """Return a photo to take now, if any, and by how much to slow the flight."""
        self._settle(flight, metre)
        if not self._left:
            return None, 1.0
        past = (metre - self._left[0]) * self._sign
        if past < -DUE_M:
            return None, 1.0
        now = flight.now_s
        if self._waiting_s is None:
            self._waiting_s = now
        waited = now - self._waiting_s
        slow = 0.3 if past < STAND_M else 0.0
        if now - self._taken_s < flight.settings.camera.min_interval_s:
            return None, slow
        marks = []
        if not _aimed(flight, aim):
            if waited < AIM_WAIT_S:
                return None, slow
            marks.append("aim")
        exposure = flight.observation.exposure
        fresh = exposure is not None and now - exposure.stamp_s < 1.0
        if exposure is None or not fresh or not exposure.in_range:
            if waited < flight.settings.exposure.max_wait_s:
                return None, slow
            marks.append("exposure")
        track = flight.observation.blade
        if track is None or track.from_model:
            marks.append("from_model")
        target = self._left.pop(0)
        photo = flight.ledger.ask(self._leg, target, metre, now)
        self._asked.append(photo)
        self._taken_s, self._waiting_s = now, None
        return (
            PhotoCommand(
                photo_id=photo.photo_id,
                blade=self._leg.blade,
                side=self._leg.side,
                metre=metre,
                distance_m=distance_m,
                foot_w=(float(foot_w[0]), float(foot_w[1]), float(foot_w[2])),
                repeated=target in self._again or self._leg.again,
                marks=tuple(marks),
            ),
            1.0,
        )

    def _settle(self, flight: Flight, metre: float) -> None:
        """A photo that failed is taken again at once while its metre is near; else it is a gap."""
        for photo in list(self._asked):
            if photo.status is PhotoStatus.ASKED and flight.now_s - photo.asked_s > CONFIRM_S:
                flight.ledger.settle(photo.photo_id, PhotoStatus.FAILED)
            if photo.status is PhotoStatus.ASKED:
                continue
            self._asked.remove(photo)
            near = abs(metre - photo.target_m) < 0.6 * self._leg.spacing_m
            if photo.status is not PhotoStatus.TAKEN and near and photo.target_m not in self._again:
                self._again.add(photo.target_m)
                self._left.insert(0, photo.target_m)


def _aimed(flight: Flight, aim: GimbalAim) -> bool:
    """Return whether the gimbal really looks where it was told, within the tolerance."""
    state = flight.observation.gimbal
    if state is None or flight.now_s - state.stamp_s > 0.5:
        return False
    cosine = math.sin(aim.pitch_rad) * math.sin(state.pitch_rad) + math.cos(
        aim.pitch_rad
    ) * math.cos(state.pitch_rad) * math.cos(aim.yaw_rad - state.yaw_rad)
    off = math.degrees(math.acos(min(1.0, max(-1.0, cosine))))
    return off <= flight.settings.gimbal.aim_tolerance_deg
