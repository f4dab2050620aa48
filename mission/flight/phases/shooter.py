"""Photos along a leg: when each is due, what it waits for, and what became of it."""

from __future__ import annotations

import math

import numpy as np

from mission.flight.command import GimbalAim, PhotoCommand
from mission.flight.flight import Flight
from mission.flight.footprint import SKIN_NEARER_M
from mission.flight.ledger import Photo, PhotoStatus
from mission.flight.leg import Leg
from mission.flight.motion import Motion, sight_w
from mission.flight.observation import ExposureState
from mission.flight.skin import Look
from perception.geometry import rotation_from_quaternion
from perception.values import Float

#: A photo is due this much before its metre: half of what is flown in a tick, and a little.
DUE_M = 0.12
#: Past its metre by this much the vehicle stands until the photo is taken.
STAND_M = 0.4
AIM_WAIT_S = 3.0
CONFIRM_S = 4.0
#: A photo is asked for while the blur is below this share of what is allowed.
CALM_SHARE = 0.9
#: While a gust lasts, or the vehicle is still too fast, it waits and slows at most so long.
CALM_WAIT_S = 3.0
SLOW = 0.3
#: How long a camera stores a photo that takes longer than its last one did.
STORING_S = 0.3
#: From the order to the shutter, over the link.
LAG_S = 0.07
#: The shutter opens within this time of the order; where the camera then was is what it shows.
OPENS_AFTER_S, OPENS_BEFORE_S = 0.03, 0.12
#: A blade not seen for longer is held by the fitted rotor, and the photo says so.
SEEN_S = 1.0
#: Metering older than this says nothing of the light now.
METERED_S = 0.5
#: A photo is taken again at once at most so often; then it is a gap.
AT_ONCE = 2


class Shooter:
    """Decides the photos of one leg."""

    def __init__(self, leg: Leg, photos: tuple[float, ...], motion: Motion) -> None:
        self._leg = leg
        self._motion = motion
        self._left = list(photos)
        self._sign = 1.0 if len(photos) < 2 or photos[-1] >= photos[0] else -1.0
        self._waiting_s: float | None = None
        self._taken_s = -math.inf
        self._stored_s = 0.0
        """How long the camera took to tell of the last photo."""
        self._asked: list[Photo] = []
        self._again: dict[float, int] = {}
        self._right_since_s: float | None = None
        """Stamp of the first of the frames in a row that show the blade in range."""

    @property
    def left(self) -> tuple[float, ...]:
        """Metres of the photos that are still to be taken."""
        return tuple(self._left)

    def done(self, now_s: float) -> bool:
        """Return whether no photo is left, and of each it is known what became of it."""
        closed = now_s - self._taken_s > OPENS_BEFORE_S + 0.05
        return closed and not self._left and not self._asked

    def step(
        self,
        flight: Flight,
        metre: float,
        distance_m: float,
        aim: GimbalAim,
        foot_w: Float,
        shift_w: Float,
        speed_mps: float,
    ) -> tuple[PhotoCommand | None, float]:
        """Return a photo to take now, if any, and by how much to slow the flight.

        ``foot_w``: (3,) what the camera is aimed at; ``shift_w``: (3,) of the plan, as registered;
        ``speed_mps``: of the leg, when nothing slows it.
        """
        self._look(flight, distance_m, shift_w)
        self._settle(flight, metre)
        self._follow(flight.observation.exposure)
        if not self._left:
            return None, 1.0
        past = (metre - self._left[0]) * self._sign
        if past < -DUE_M:
            return None, self._pace(flight, -past, speed_mps)
        now = flight.now_s
        if self._waiting_s is None:
            self._waiting_s = now
        slow = SLOW if past < STAND_M else 0.0
        if now - self._taken_s < flight.settings.camera.min_interval_s or self._storing():
            return None, slow
        marks = self._doubts(flight, distance_m, aim, now - self._waiting_s)
        if marks is None:
            return None, slow
        target = self._left.pop(0)
        metre += LAG_S * float(np.array(flight.vehicle.velocity_w) @ self._leg.axis_w)
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
                marks=marks,
            ),
            1.0,
        )

    def _pace(self, flight: Flight, ahead_m: float, speed_mps: float) -> float:
        """Return by how much to slow so as to arrive when the next photo can be taken.

        A vehicle that has to wait and begins to brake only there flies past by metres.
        """
        settings, now = flight.settings, flight.now_s
        wait_s = self._taken_s + settings.camera.min_interval_s - now
        if self._storing():
            wait_s = max(wait_s, self._taken_s + self._stored_s - now, STORING_S)
        if self._exposed(flight.observation.exposure, now) == "exposure":
            wait_s = max(wait_s, settings.exposure.max_wait_s)
        if wait_s * speed_mps <= ahead_m:
            return 1.0
        return max(SLOW, ahead_m / (wait_s * speed_mps))

    def _storing(self) -> bool:
        """Return whether the camera has not told of the last photo: the next would be late."""
        return any(photo.status is PhotoStatus.ASKED for photo in self._asked)

    def _doubts(
        self, flight: Flight, distance_m: float, aim: GimbalAim, waited_s: float
    ) -> tuple[str, ...] | None:
        """Return why a photo taken now may be doubtful; None: wait for a better moment."""
        settings, observation = flight.settings, flight.observation
        marks = []
        if not _aimed(flight, aim):
            if waited_s < AIM_WAIT_S:
                return None
            marks.append("aim")
        most_px = settings.camera.max_blur_px
        blur_px = self._motion.blur_px(observation, distance_m - SKIN_NEARER_M)
        if blur_px > CALM_SHARE * most_px:
            if waited_s < CALM_WAIT_S:
                return None
            if blur_px > most_px:
                marks.append("blur")
        exposed = self._exposed(observation.exposure, flight.now_s)
        if exposed is not None:
            if exposed != "limit" and waited_s < settings.exposure.max_wait_s:
                return None
            marks.append(exposed)
        track = observation.blade
        seen = track is not None and flight.now_s - track.stamp_s < SEEN_S
        if track is None or track.from_model or not seen:
            marks.append("from_model")
        return tuple(marks)

    def _follow(self, exposure: ExposureState | None) -> None:
        """Note since which frame the blade is in range without a break."""
        if exposure is None or not exposure.in_range:
            self._right_since_s = None
        elif self._right_since_s is None:
            self._right_since_s = exposure.stamp_s

    def _exposed(self, exposure: ExposureState | None, now_s: float) -> str | None:
        """Return None where the blade is exposed right, else what is to be marked.

        Two frames in a row must say so: a single one may have been metered beside the blade, or
        just before the light changed. ``limit``: the camera has no exposure that would do.
        """
        if exposure is None or now_s - exposure.stamp_s > METERED_S:
            return "exposure"
        if not exposure.in_range:
            return "limit" if exposure.at_limit else "exposure"
        since = self._right_since_s
        return "exposure" if since is None or exposure.stamp_s <= since else None

    def _look(self, flight: Flight, distance_m: float, shift_w: Float) -> None:
        """Note of the photo under way from where it is taken, and how the camera moves."""
        if not self._asked:
            return
        photo, gimbal = self._asked[-1], flight.observation.gimbal
        since = flight.now_s - photo.asked_s
        if gimbal is None or not OPENS_AFTER_S <= since <= OPENS_BEFORE_S:
            return
        vehicle = flight.vehicle
        body = rotation_from_quaternion(np.array(vehicle.quaternion_wb))
        eye = np.array(vehicle.position_w) + body @ np.array(flight.settings.camera.offset_m)
        blur_px = self._motion.blur_px(flight.observation, distance_m - SKIN_NEARER_M)
        before = photo.look
        if before is not None:
            blur_px = max(blur_px, before.blur_px)
        look = Look(eye - shift_w, sight_w(gimbal), blur_px)
        flight.ledger.looked(photo, look, flight.settings)

    def _settle(self, flight: Flight, metre: float) -> None:
        """A photo that failed is taken again at once while its metre is near; else it is a gap."""
        most_px = flight.settings.camera.max_blur_px
        for photo in list(self._asked):
            since = flight.now_s - photo.asked_s
            if photo.status is PhotoStatus.ASKED and since > CONFIRM_S:
                flight.ledger.settle(photo.photo_id, PhotoStatus.FAILED)
            if since > OPENS_BEFORE_S and photo.look is not None and photo.look.blur_px > most_px:
                flight.ledger.settle(photo.photo_id, PhotoStatus.BLURRED)
            if photo.status is PhotoStatus.ASKED:
                continue
            self._asked.remove(photo)
            self._stored_s = since
            near = abs(metre - photo.target_m) < 0.6 * self._leg.spacing_m
            tried = self._again.get(photo.target_m, 0)
            if photo.status is not PhotoStatus.TAKEN and near and tried < AT_ONCE:
                self._again[photo.target_m] = tried + 1
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
