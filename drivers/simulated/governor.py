"""How fast the simulated world runs: a slow pace by the load, a quick brake by its renderer.

The pace lies between real time and 2.5 times as fast and yields to a loaded machine: faster, the
way of a scan through the processes would take too much of its 0.3 s of mission time. The brake
makes the world wait, down to a standstill, for its own renderer and for nobody else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

_SLOWEST, _FASTEST, _FIRST = 1.0, 2.5, 1.5
#: Mission seconds by which the newest finished scan may lag: from here the world slows, there it
#: stands. A scan is 0.1 s long, so that much is never behind.
_LAG_EASY_S, _LAG_STAND_S = 0.22, 0.45
#: Share of the machine that may be busy before the pace falls; below the second it may rise.
_BUSY, _QUIET = 0.90, 0.80
#: The world itself may be this far (mission seconds) behind its clock.
_BEHIND_S = 0.06
#: Change of the pace per wall second.
_RISE_PER_S, _FALL_PER_S = 0.12, 0.6


@dataclass(frozen=True, slots=True)
class Load:
    """What the governor looks at."""

    renderer_lag_s: float
    """Mission seconds from the newest finished scan to now."""
    world_lag_s: float
    """Mission seconds from the newest step of the world to now."""
    busy: float
    """Share of all cores, 0-1."""


class Governor:
    """Chooses mission seconds per wall second."""

    def __init__(self, speed: float | Literal["auto"]) -> None:
        self._auto = speed == "auto"
        self.pace = _FIRST if speed == "auto" else float(speed)

    def step(self, load: Load, wall_s: float) -> float:
        """Return the factor for the next moment; ``wall_s`` passed since the last one."""
        if self._auto:
            self._adapt(load, wall_s)
        return self.pace * _brake(load.renderer_lag_s)

    def _adapt(self, load: Load, wall_s: float) -> None:
        strained = load.renderer_lag_s > _LAG_EASY_S or load.world_lag_s > _BEHIND_S
        if strained or load.busy > _BUSY:
            self.pace *= max(1 - _FALL_PER_S * wall_s, 0.5)
        elif load.busy < _QUIET:
            self.pace *= 1 + _RISE_PER_S * wall_s
        self.pace = min(max(self.pace, _SLOWEST), _FASTEST)


def _brake(lag_s: float) -> float:
    """Return 1 while the renderer keeps up, falling to 0 where the world stands and waits."""
    share = (_LAG_STAND_S - lag_s) / (_LAG_STAND_S - _LAG_EASY_S)
    return min(max(share, 0.0), 1.0)
