"""How far the vehicle's own position has wandered since the rotor was measured.

A position from satellites wanders slowly. The rotor stands still, so what the LiDAR sees of a
blade tells the wander across that blade, and where its tip is seen, along it. The wander is a
first-order Gauss-Markov process; the filter keeps its value w and the value c it had when the
rotor was measured, and gives d = w - c: reported position less position in the rotor's frame.
Where the rotor's hub was measured wrongly, that is part of c: what is known of the rotor is laid
right by what is seen of it later. A vehicle's velocity does not wander as its position does: what
the position moves beyond it is wander, and is followed. An error of the heading turns all that is
seen about the vehicle; it is kept beside.
World ENU, metres, mission seconds.
"""

from __future__ import annotations

import math

import numpy as np

from perception.values import Float

#: While everything fixed was sighted so lately, one blade alone is not learnt from besides.
SIGHTED_S = 4.0
#: What is more standard deviations off than this was not of the blade.
_GATE = 3.0
#: What an integrated velocity loses in a second, growing with its root: 0.05 m/s for two seconds.
_VELOCITY_WALK_M = 0.1
#: A heading by the compass is wrong by so much, and alike for so long.
_HEADING_RAD, _HEADING_S = math.radians(1.0), 40.0
#: Reports farther apart do not tell what was flown between them.
_GAP_S = 0.6


def whole_covariance(upper: tuple[float, ...]) -> Float:
    """Return the covariance (4, 4) whose upper triangle is told row by row."""
    half: Float = np.zeros((4, 4))
    half[np.triu_indices(4)] = upper
    whole: Float = half + np.triu(half, 1).T
    return whole


def turned(heading_rad: float, levers: Float) -> Float:
    """Return how far (..., 3) an error of the heading moves what lies at levers (..., 3)."""
    aside = np.stack([-levers[..., 1], levers[..., 0], np.zeros(levers.shape[:-1])], axis=-1)
    return np.asarray(heading_rad * aside, np.float64)


class FrameDrift:
    """Kalman filter of d (3,); begins with d = 0 when the rotor was measured.

    ``sigma_m``, ``time_s``: of the wander; ``rotor_sigma_m``: how far the measured hub may be off;
    ``heading_sigma_rad``: of the vehicle's heading.
    """

    def __init__(
        self,
        sigma_m: float,
        time_s: float,
        start_s: float,
        rotor_sigma_m: float = 0.0,
        heading_sigma_rad: float = _HEADING_RAD,
    ) -> None:
        self._variance = sigma_m**2
        self._time_s = time_s
        self._heading_variance = heading_sigma_rad**2
        self._stamp_s = start_s
        self._last: tuple[float, Float, Float] | None = None
        self._state: Float = np.zeros(7)
        """w (3), c (3), heading."""
        block = self._variance * np.eye(3)
        rotor = rotor_sigma_m**2 * np.eye(3)
        self._covariance: Float = np.zeros((7, 7))
        self._covariance[:6, :6] = np.block([[block, block], [block, block + rotor]])
        self._covariance[6, 6] = self._heading_variance

    @property
    def stamp_s(self) -> float:
        """Time up to which measurements were taken."""
        return self._stamp_s

    def measure(self, stamp_s: float, direction_w: Float, offset_m: float, sigma_m: float) -> bool:
        """Take how far something fixed appears moved along a unit direction (3,).

        Measurements older than what was taken already count as of now: the wander is slow. Returns
        False for one that is too far off to be the same thing: it is left out.
        """
        return self._take(stamp_s, np.append(direction_w, 0.0), offset_m, sigma_m)

    def see(self, stamp_s: float, seen: Float, covariance: Float) -> None:
        """Take how far everything fixed appears moved and turned.

        ``seen``: (4,) metres, and radians about the vehicle, counter-clockwise from above;
        ``covariance``: (4, 4).
        """
        variances, axes = np.linalg.eigh(covariance)
        for variance, axis in zip(variances, axes.T, strict=True):
            self._take(stamp_s, axis, float(seen @ axis), math.sqrt(max(variance, 0.0)))

    def sighted(
        self,
        stamp_s: float,
        offset_w: tuple[float, ...],
        heading_rad: float,
        upper: tuple[float, ...],
    ) -> None:
        """Take a sighting as it is told: ``upper`` is its covariance, as `whole_covariance`."""
        self.see(stamp_s, np.append(offset_w, heading_rad), whole_covariance(upper))

    def _take(self, stamp_s: float, direction: Float, value: float, sigma: float) -> bool:
        """Take a measurement of d and heading along a direction (4,) of both."""
        if stamp_s > self._stamp_s:
            self._state, self._covariance = self._at(stamp_s)
            self._stamp_s = stamp_s
        row = np.concatenate([direction[:3], -direction[:3], direction[3:]])
        spread = self._covariance @ row
        variance = float(row @ spread) + sigma**2
        surprise = value - float(row @ self._state)
        if surprise**2 > _GATE**2 * variance:
            return False
        gain = spread / variance
        self._state = self._state + gain * surprise
        keep = np.eye(7) - np.outer(gain, row)
        # Joseph's form: stays symmetric and positive.
        self._covariance = keep @ self._covariance @ keep.T + sigma**2 * np.outer(gain, gain)
        return True

    def move(self, stamp_s: float, position_w: Float, velocity_w: Float) -> None:
        """Take the vehicle's reported position and velocity (3,), one report after the other."""
        last, self._last = self._last, (stamp_s, position_w, velocity_w)
        if last is None or not 0.0 < stamp_s - last[0] < _GAP_S or self._stamp_s >= stamp_s:
            return
        if self._stamp_s < last[0]:
            self._state, self._covariance = self._at(last[0])
        step_s = stamp_s - last[0]
        beyond = position_w - last[1] - 0.5 * (velocity_w + last[2]) * step_s
        decay = math.exp(-step_s / self._time_s)
        fresh = self._variance * (1 - decay**2)
        # Two tell of the new value: the old one that fades, and the old one moved by `beyond`.
        share = fresh / (fresh + _VELOCITY_WALK_M**2 * step_s) if fresh > 0 else 0.0
        kept = decay + share * (1 - decay)
        self._state, self._covariance = self._stepped(step_s, kept, fresh * (1 - share))
        self._state[:3] += share * beyond
        self._stamp_s = stamp_s

    def at(self, stamp_s: float) -> tuple[Float, Float]:
        """Return d (3,) at a time, and its covariance (3, 3)."""
        state, covariance = self._at(max(stamp_s, self._stamp_s))
        difference = np.hstack([np.eye(3), -np.eye(3), np.zeros((3, 1))])
        return difference @ state, difference @ covariance @ difference.T

    def heading(self, stamp_s: float) -> tuple[float, float]:
        """Return by how much all that is seen appears turned, and its standard deviation."""
        state, covariance = self._at(max(stamp_s, self._stamp_s))
        return float(state[6]), math.sqrt(max(float(covariance[6, 6]), 0.0))

    def _at(self, stamp_s: float) -> tuple[Float, Float]:
        decay = math.exp(-(stamp_s - self._stamp_s) / self._time_s)
        return self._stepped(stamp_s - self._stamp_s, decay, self._variance * (1 - decay**2))

    def _stepped(self, step_s: float, kept: float, fresh: float) -> tuple[Float, Float]:
        """Return state and covariance after a time, by what is kept of the wander and is new."""
        turned = math.exp(-step_s / _HEADING_S)
        share = np.array([kept] * 3 + [1.0] * 3 + [turned])
        grown = self._covariance * np.outer(share, share)
        grown[[0, 1, 2], [0, 1, 2]] += fresh
        grown[6, 6] += self._heading_variance * (1 - turned**2)
        return share * self._state, grown
