"""Centring: photos as they come back tell how far beside the picture's middle the blade lies.

The camera is aimed at where the LiDAR has the blade's middle, or the fitted rotor where the LiDAR
sees none. Errors of heading and attitude and, unseen by the LiDAR, the position's drift put it
decimetres beside that, alike for tens of seconds. A photo's outline tells it to some centimetres, a
few seconds late: the aim of the photos that follow is moved by it. The vehicle's way is not.
What is learnt while the LiDAR holds the blade and while it does not are two things.
World ENU, metres, mission seconds.
"""

from __future__ import annotations

import math

import numpy as np

from config.photos import Positioning
from mission.flight.leg import Leg
from mission.flight.observation import PhotoResult
from perception.values import Float

#: What is beside the aim is alike for so long, and so large along each axis: of a blade that the
#: LiDAR sees, and of one that it does not see. There the position's drift is known to a share.
TIME_S = 40.0
SEEN_SIGMA_M, UNSEEN_SIGMA_M, WANDER_SHARE = 0.15, 0.3, 0.5
#: An outline and the gimbal's own lag err by so much together, and the position's noise is in both.
PHOTO_SIGMA_M, NOISE_SHARE = 0.1, 0.5
#: What is more standard deviations off than this was not of the blade.
GATE = 3.0
#: The aim is never moved farther.
MOST_M = 1.0
#: The LiDAR has held the blade, or has not, for so long: what was aimed at has settled.
SETTLED_S = 2.0
#: From another side what was learnt on the last leg need not hold.
SAME_VIEW = 0.5


class Centring:
    """How far (3,) beside its target the camera is aimed."""

    def __init__(self, positioning: Positioning) -> None:
        wander_m = WANDER_SHARE * positioning.wander_sigma_m
        photo_m = math.hypot(PHOTO_SIGMA_M, NOISE_SHARE * positioning.noise_sigma_m)
        self._seen = _Offset(SEEN_SIGMA_M, photo_m)
        self._unseen = _Offset(math.hypot(UNSEEN_SIGMA_M, wander_m), photo_m)
        self._leg: Leg | None = None
        self._held = (False, False)
        """Unseen; and, by the LiDAR or by the rotor, found since the leg began."""
        self._since_s = math.inf
        self._asked: dict[int, tuple[_Offset, Float, Float]] = {}
        """Photos under way: what is learnt from them, what the aim was moved by, and how far beside
        the blade it was meant."""

    @property
    def value_w(self) -> Float:
        """(3,) to be added to what is aimed at."""
        value = self._offset.value_w
        return value * min(1.0, MOST_M / max(float(np.linalg.norm(value)), 1e-9))

    def begin(self, leg: Leg, now_s: float) -> None:
        """Begin a leg: what was learnt of unseen blades is kept where this one is seen alike."""
        before, self._leg = self._leg, leg
        self._asked.clear()
        self._held, self._since_s = (leg.blind, leg.blind), now_s
        self._seen.forget(now_s)
        if before is None or float(before.view_w @ leg.view_w) <= SAME_VIEW:
            self._unseen.forget(now_s)

    def step(
        self, photos: tuple[PhotoResult, ...], now_s: float, *, unseen: bool, firm: bool
    ) -> None:
        """Take in a tick: photos judged since, and what the camera is aimed by.

        ``unseen``: the fitted rotor has the blade, not the LiDAR; ``firm``: the LiDAR sees it now.
        """
        held = unseen, unseen or firm or self._held == (False, True)
        if held != self._held:
            self._held, self._since_s = held, now_s
        for photo in photos:
            then = self._asked.pop(photo.photo_id, None)
            if then is not None and photo.beside_w is not None and self._leg is not None:
                offset, moved_w, aside_w = then
                across: Float = np.asarray(np.cross(self._leg.axis_w, self._leg.view_w), np.float64)
                across = across / float(np.linalg.norm(across))
                offset.learn(np.array(photo.beside_w) + moved_w + aside_w, across, now_s)

    def asked(self, photo_id: int, metre: float, now_s: float) -> None:
        """A photo is taken now, aimed as `value_w` has it."""
        leg, (_, found) = self._leg, self._held
        settled = leg is not None and (leg.blind or now_s - self._since_s >= SETTLED_S)
        if leg is not None and found and settled:
            self._asked[photo_id] = (self._offset, self.value_w, leg.aside(metre))

    @property
    def _offset(self) -> _Offset:
        return self._unseen if self._held[0] else self._seen


class _Offset:
    """A Kalman filter of an offset (3,) that wanders about zero (first-order Gauss-Markov)."""

    def __init__(self, sigma_m: float, photo_sigma_m: float) -> None:
        self._sigma_m, self._photo_sigma_m = sigma_m, photo_sigma_m
        self.forget(0.0)

    def forget(self, now_s: float) -> None:
        """Begin anew: nothing is known."""
        self.value_w: Float = np.zeros(3)
        self._covariance: Float = self._sigma_m**2 * np.eye(3)
        self._stamp_s = now_s

    def learn(self, seen_w: Float, across: Float, now_s: float) -> None:
        """Take where something (3,) was seen along a unit direction (3,)."""
        self._advance(now_s)
        spread = self._covariance @ across
        variance = float(across @ spread) + self._photo_sigma_m**2
        surprise = float(across @ (seen_w - self.value_w))
        if not math.isfinite(surprise) or surprise**2 > GATE**2 * variance:
            return
        gain = spread / variance
        self.value_w = self.value_w + gain * surprise
        self._covariance = self._covariance - np.outer(gain, spread)

    def _advance(self, now_s: float) -> None:
        kept = math.exp(-max(now_s - self._stamp_s, 0.0) / TIME_S)
        self.value_w = kept * self.value_w
        fresh = self._sigma_m**2 * (1 - kept**2)
        self._covariance = kept**2 * self._covariance + fresh * np.eye(3)
        self._stamp_s = max(now_s, self._stamp_s)
