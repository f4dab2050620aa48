"""Is the rotor turning? From how its picture in the rotor plane turns between accumulations.

Points in the rotor's slab are gathered over half a second at a time into a polar picture (ring by
angle). Two such pictures of a still rotor match best unturned, those of a turning one at the angle
turned in between, whichever blades were seen and wherever on the chord: the same ring is compared
with itself. The rate is the slope of that angle over the lag between pictures. A turn is told only
from an unbroken run of pictures: over a gap in the scans (late, lost, held up) the position has
wandered, and what has moved meanwhile cannot be told from what has turned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.tower import Tower
from perception.values import Float

Complex = NDArray[np.complex128]

WINDOW_S = 0.5
#: Pictures kept: the newest 4 s.
WINDOWS = 8
ANGLES = 1440
RING_M = 1.5
#: Nacelle and spinner fill the inner rings, turn or not.
INNER_M = 6.0
MIN_CELLS = 40
#: A picture ends where the scans have a gap; and a run, where the pictures have one.
SCAN_GAP_S = 0.6
PICTURE_GAP_S = 1.0
#: Pictures of a run from which a rate is told.
LEAST_PICTURES = 4
RECENT_S = 5.0
#: Position and heading wander: seen from afar the tower does not stand where it was measured.
TOWER_SKIN_M = 2.0
#: Rates below this are not told from the vehicle's own drift.
SLOWEST_DPS = 0.4
#: Pictures are compared within this turn; blades repeat every 120 deg.
MAX_TURN_DEG = 50.0


@dataclass(frozen=True, slots=True)
class RotorMotion:
    """How fast the rotor turns."""

    rate_dps: float
    """Counter-clockwise seen from the front, as the stop angle grows."""
    sigma_dps: float
    turning: bool


class RotorMotionWatch:
    """Gathers polar pictures of the rotor and compares them."""

    def __init__(
        self, hub_w: Float, normal_w: Float, radius_m: float, tower: Tower | None = None
    ) -> None:
        """Watch the rotor of a prior (or measured) hub, (3,), and normal, (3,) downwind.

        ``tower``: its skin is left out, for near a big tower it reaches into the blades' slab
        and, standing still, speaks for a still rotor.
        """
        self._tower = tower
        self._hub_w = np.asarray(hub_w, np.float64)
        normal = np.asarray(normal_w, np.float64)
        self._normal_w = normal / np.linalg.norm(normal)
        down = np.array([0.0, 0.0, -1.0])
        down = down - (down @ self._normal_w) * self._normal_w
        self._down_w = down / np.linalg.norm(down)
        self._right_w: Float = np.cross(self._down_w, self._normal_w)
        self._radius_m = radius_m
        self._rings = math.ceil((radius_m + 2.0 - INNER_M) / RING_M)
        self._stamps_s: list[float] = []
        """Of the scans in the picture that is gathered."""
        self._picture = np.zeros((self._rings, ANGLES))
        self._pictures: list[tuple[float, Complex]] = []
        self._blur = np.exp(-0.5 * (_signed_bins() / (0.6 * ANGLES / 360.0)) ** 2)

    def update(self, points_w: Float, stamp_s: float) -> None:
        """Take in one scan: (N, 3) world metres, measured about ``stamp_s``."""
        stamps_s = self._stamps_s
        if stamps_s and stamp_s <= stamps_s[-1]:
            return  # the same scan again, or one that was overtaken
        if stamps_s and (stamp_s - stamps_s[0] >= WINDOW_S or stamp_s - stamps_s[-1] > SCAN_GAP_S):
            self._close()
        self._stamps_s.append(stamp_s)
        offset = points_w - self._hub_w
        depth = offset @ self._normal_w
        # Blades stand before the tower, and lean and bend away from it by a tenth of their length;
        # feathered chords reach a good metre downwind, more where the normal is wrong.
        apart = np.linalg.norm(offset, axis=1)
        slab = (depth > -5.0 - 0.1 * apart) & (depth < 1.8 + 0.03 * apart)
        if self._tower is not None:
            slab &= self._tower.surface_distance(points_w) > TOWER_SKIN_M
        offset = offset[slab]
        x, y = offset @ self._down_w, offset @ self._right_w
        ring = np.floor((np.hypot(x, y) - INNER_M) / RING_M)
        inside = (ring >= 0) & (ring < self._rings)
        angle = np.floor((np.arctan2(y[inside], x[inside]) / (2 * np.pi) % 1.0) * ANGLES)
        np.add.at(self._picture, (ring[inside].astype(int), angle.astype(int) % ANGLES), 1.0)

    def _close(self) -> None:
        """End a picture, of the time when its scans were taken, and begin the next."""
        if int((self._picture > 0).sum()) >= MIN_CELLS:
            # Roots of counts, and by radius: near rings must not drown the far ones, which turn the
            # most and are least turned by a wander of the position.
            radii = INNER_M + RING_M * (np.arange(self._rings) + 0.5)
            share = (radii / radii[-1])[:, None]
            spectrum = np.fft.rfft(share * np.sqrt(self._picture), axis=1)
            taken_s = float(np.mean(self._stamps_s))
            self._pictures = [*self._pictures[-(WINDOWS - 1) :], (taken_s, spectrum)]
        self._picture = np.zeros((self._rings, ANGLES))
        self._stamps_s = []

    def _run(self) -> list[tuple[float, Complex]]:
        """Return the newest pictures that follow each other without a gap."""
        run = self._pictures[-1:]
        for picture in reversed(self._pictures[:-1]):
            if run[0][0] - picture[0] > PICTURE_GAP_S:
                break
            run.insert(0, picture)
        return run

    def result(self) -> RotorMotion | None:
        """Return the motion over the last seconds, None where too little was seen."""
        run = self._run()
        if len(run) >= LEAST_PICTURES:
            return self._motion(run)
        # Where a gap lies between, blades that stand as they stood are still; else who knows.
        newest_s = self._pictures[-1][0] if self._pictures else 0.0
        recent = [picture for picture in self._pictures if picture[0] > newest_s - RECENT_S]
        motion = self._motion(recent) if len(recent) >= LEAST_PICTURES else None
        return None if motion is None or motion.turning else motion

    def _motion(self, pictures: list[tuple[float, Complex]]) -> RotorMotion:
        lags, turns = [], []
        guess = 0.0
        for step in range(1, len(pictures)):
            for (t0, one), (t1, other) in zip(pictures, pictures[step:], strict=False):
                reach = MAX_TURN_DEG if step == 1 else 4.0 + 1.0 * step
                turns.append(self._turn(one, other, guess * (t1 - t0), reach))
                lags.append(t1 - t0)
            # Longer lags are searched about what the shorter ones have shown.
            guess = float(np.median(np.array(turns) / np.array(lags)))
        return _slope(np.array(lags), np.array(turns))

    def _turn(self, one: Complex, other: Complex, about_deg: float, reach_deg: float) -> float:
        """Return the turn (degrees) at which two pictures match best."""
        match = np.fft.irfft((np.conj(one) * other).sum(axis=0), ANGLES)
        match = np.fft.irfft(np.fft.rfft(match) * np.fft.rfft(self._blur), ANGLES)
        turn = _signed_bins() * 360.0 / ANGLES
        near = np.abs(turn - about_deg) <= reach_deg
        if not near.any():
            return about_deg
        best = int(np.argmax(np.where(near, match, -np.inf)))
        left, top, right = match[best - 1], match[best], match[(best + 1) % ANGLES]
        bend = left - 2 * top + right
        part = 0.5 * (left - right) / bend if bend < 0 else 0.0
        return float(turn[best] + np.clip(part, -0.5, 0.5) * 360.0 / ANGLES)


def _signed_bins() -> Float:
    bins = np.arange(ANGLES)
    return np.where(bins < ANGLES // 2, bins, bins - ANGLES).astype(np.float64)


def _slope(lags: Float, turns: Float) -> RotorMotion:
    """Return the robust slope of turn over lag, through the origin."""
    rate = float(np.median(turns / lags))
    for _ in range(5):
        residual = turns - rate * lags
        scale = max(1.5 * float(np.median(np.abs(residual))), 0.1)
        weight = lags**2 / (1 + (residual / scale) ** 2)
        rate = float((weight * turns / lags).sum() / weight.sum())
    residual = np.abs(turns - rate * lags)
    # Pairs share pictures: only as many are independent as there are pictures.
    pictures = 0.5 * (1 + math.sqrt(1 + 8 * len(lags)))
    spread = max(1.5 * float(np.median(residual)), 0.05)
    sigma = spread / math.sqrt(pictures) / float(np.sqrt(np.mean(lags**2)))
    return RotorMotion(rate, sigma, abs(rate) > SLOWEST_DPS and abs(rate) > 4 * sigma)
