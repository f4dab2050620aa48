"""What the autopilot believes about itself beside what is true.

Position: Gauss-Markov wander and short noise, by the profile of its GNSS (with or without RTK).
Attitude: a slow error of half a degree, heading twice that. Faults of GPS, compass and barometer
act here. World frame ENU, metres, radians.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from random import Random
from typing import Literal

Vec3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ErrorProfile:
    """Standard deviations and times of the wander of one positioning method."""

    noise_m: float
    walk_m: float
    noise_s: float = 0.3
    walk_s: float = 60.0
    velocity_mps: float = 0.03


PROFILES = {
    "rtk": ErrorProfile(noise_m=0.03, walk_m=0.2),
    "gnss": ErrorProfile(noise_m=0.3, walk_m=1.5, noise_s=1.5, velocity_mps=0.08),
}

_ATTITUDE_RAD = math.radians(0.5)
_ATTITUDE_S = 40.0
#: Rehearsed faults: a jump of 8 m in 1 s, a drift of 0.5 m/s, 15 deg of heading, 20 m of height.
_JUMP_M, _JUMP_S = 8.0, 1.0
_DRIFT_MPS = 0.5
_COMPASS_RAD = math.radians(15.0)
_BARO_M = 20.0
_BARO_LATE_S = 1.0


class GaussMarkov:
    """First-order Gauss-Markov process of a given standard deviation and time constant."""

    def __init__(self, sigma: float, time_s: float, random: Random) -> None:
        self._sigma, self._time_s, self._random = sigma, time_s, random
        self.value = random.gauss(0.0, sigma)
        self.rate = 0.0

    def step(self, dt_s: float) -> float:
        """Return the value after ``dt_s``."""
        decay = math.exp(-dt_s / self._time_s)
        before = self.value
        self.value = before * decay
        self.value += self._sigma * math.sqrt(1 - decay * decay) * self._random.gauss(0.0, 1.0)
        self.rate = (self.value - before) / dt_s
        return self.value


class EstimatorError:
    """Error of the autopilot's estimate: estimate minus truth."""

    def __init__(self, profile: Literal["rtk", "gnss"], random: Random) -> None:
        law = PROFILES[profile]
        self._random = random
        self._law = law
        self._noise = [GaussMarkov(law.noise_m, law.noise_s, random) for _ in range(3)]
        self._walk = [GaussMarkov(law.walk_m, law.walk_s, random) for _ in range(3)]
        # The filter starts where it stands: home is where the estimate says zero.
        self._zero = [w.value for w in self._walk]
        self._tilt = [GaussMarkov(_ATTITUDE_RAD, _ATTITUDE_S, random) for _ in range(2)]
        self._heading = GaussMarkov(2 * _ATTITUDE_RAD, _ATTITUDE_S, random)
        self._words: dict[str, str] = {}
        self._extra = [0.0, 0.0, 0.0]
        self._extra_yaw = 0.0
        self._frozen: Vec3 | None = None
        self._frozen_height: float | None = None
        self._time_s = 0.0
        self.reset_count = 0
        """Jumps of the local frame: the filter was reset."""
        self.position: Vec3 = (0.0, 0.0, 0.0)
        self.velocity: Vec3 = (0.0, 0.0, 0.0)
        self.roll = self.pitch = self.yaw = 0.0
        self.position_ok = True

    def fault(self, device: str, word: str, position_w: Vec3) -> None:
        """Change the failure word of ``gps``, ``compass`` or ``baro``."""
        was = self._words.get(device, "ok")
        self._words[device] = word
        if device == "gps":
            self._frozen = position_w if word == "stuck" else None
            if was == "off" and word == "ok":
                # Back after a loss: the filter is reset onto the new fixes, a jump of its frame.
                self._extra[0] = self._extra[1] = 0.0
                self.reset_count += 1
        if device == "baro":
            self._frozen_height = position_w[2] if word == "stuck" else None

    def step(self, dt_s: float, position_w: Vec3, velocity_w: Vec3) -> None:
        """Advance all errors by ``dt_s`` of mission time."""
        self._time_s += dt_s
        gps = self._words.get("gps", "ok")
        self.position_ok = gps != "off" and not (gps == "intermittent" and self._now_and_then())
        before = tuple(self._extra)
        self._gps(gps, dt_s, position_w, velocity_w)
        self._baro(dt_s, position_w, velocity_w)
        self._compass(dt_s)
        noisy = 30.0 if gps == "garbage" else 1.0
        total, rates = [], []
        for i in range(3):
            walk = self._walk[i].step(dt_s) - self._zero[i]
            total.append(walk + noisy * self._noise[i].step(dt_s) + self._extra[i])
            drift = (self._extra[i] - before[i]) / dt_s
            # The filter trusts its Doppler velocity: slow wander only partly shows in it.
            rate = self._random.gauss(0.0, self._law.velocity_mps) + min(max(drift, -1.0), 1.0)
            rates.append(rate)
        self.position = (total[0], total[1], total[2])
        self.velocity = (rates[0], rates[1], rates[2])
        self.roll, self.pitch = self._tilt[0].step(dt_s), self._tilt[1].step(dt_s)
        self.yaw = self._heading.step(dt_s) + self._extra_yaw

    def _gps(self, word: str, dt_s: float, position_w: Vec3, velocity_w: Vec3) -> None:
        extra = self._extra
        if word == "wrong":
            extra[0] = _towards(extra[0], _JUMP_M, _JUMP_M / _JUMP_S * dt_s)
        elif word == "slow" or not self.position_ok:
            extra[0] += _DRIFT_MPS * dt_s
        elif word == "stuck" and self._frozen is not None:
            for i in (0, 1):
                extra[i] = _towards(extra[i], self._frozen[i] - position_w[i], 2.0 * dt_s)
        elif word == "delayed":
            for i in (0, 1):
                extra[i] = _towards(extra[i], -0.5 * velocity_w[i], 2.0 * dt_s)
        else:
            for i in (0, 1):
                extra[i] = _towards(extra[i], 0.0, 0.5 * dt_s)

    def _now_and_then(self) -> bool:
        """Return whether an intermittent device is away just now: two seconds of every four."""
        return math.fmod(self._time_s, 4.0) > 2.0

    def _baro(self, dt_s: float, position_w: Vec3, velocity_w: Vec3) -> None:
        word = self._words.get("baro", "ok")
        goal = 0.0
        if word == "stuck" and self._frozen_height is not None:
            goal = self._frozen_height - position_w[2]
        elif word == "wrong":
            goal = _BARO_M
        elif word == "garbage":
            goal = self._random.gauss(0.0, 5.0)
        elif word == "delayed":
            goal = -_BARO_LATE_S * velocity_w[2]
        elif word in ("slow", "off") or (word == "intermittent" and self._now_and_then()):
            goal = self._extra[2] + _DRIFT_MPS
        self._extra[2] = _towards(self._extra[2], goal, 4.0 * dt_s)

    def _compass(self, dt_s: float) -> None:
        word = self._words.get("compass", "ok")
        goal = 0.0
        if word == "wrong":
            goal = _COMPASS_RAD
        elif word == "garbage":
            goal = self._random.gauss(0.0, _COMPASS_RAD)
        elif word == "delayed":
            # Late after every turn: about half of what a wrong one is off, and coming back.
            goal = 0.5 * _COMPASS_RAD * math.sin(self._time_s)
        elif word in ("off", "slow", "stuck") or (word == "intermittent" and self._now_and_then()):
            # Without a magnetometer the heading drifts with the gyro's bias.
            goal = self._extra_yaw + math.radians(1.0)
        self._extra_yaw = _towards(self._extra_yaw, goal, math.radians(10.0) * dt_s)


def _towards(value: float, goal: float, step: float) -> float:
    """Return the value moved to the goal by at most ``step``."""
    return value + min(max(goal - value, -step), step)
