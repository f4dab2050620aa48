"""The pack: energy drawn by hover, airspeed and climb, and the voltage that is reported."""

from __future__ import annotations

import math
from collections import deque

from config.airframe import Battery

_CELLS = 6
_FULL_V, _EMPTY_V = 4.15, 3.50
#: Computer, sensors and autopilot.
_IDLE_W = 25.0
_SLOW_S, _DELAY_S = 10.0, 30.0


class Pack:
    """State of charge over the flight."""

    def __init__(self, battery: Battery, charge: float = 1.0) -> None:
        self._battery = battery
        self.charge = charge
        """0-1"""
        self.power_w = _IDLE_W
        self.used_wh = 0.0
        self.word = "ok"
        """Failure word of what is told of it."""
        self.told = charge
        """0-1, as reported."""
        self._time_s = 0.0
        self._told_s = 0.0
        self._late: deque[tuple[float, float]] = deque()

    def renew(self) -> None:
        """A charged pack takes its place."""
        self.charge = self.told = 1.0
        self._late.clear()

    @property
    def present(self) -> bool:
        """Whether anything is reported."""
        away = self.word == "intermittent" and math.fmod(self._time_s, 16.0) > 8.0
        return not away and self.word not in ("off", "stuck")

    def step(self, dt_s: float, *, flying: bool, airspeed_mps: float, climb_mps: float) -> None:
        """Draw ``dt_s`` worth of energy."""
        law = self._battery
        self.power_w = _IDLE_W
        if flying:
            self.power_w += law.hover_w + law.drag_w_per_mps3 * airspeed_mps**3
            self.power_w += law.climb_w_per_mps * max(climb_mps, 0.0)
        used_wh = self.power_w * dt_s / 3600.0
        self.used_wh += used_wh
        self.charge = max(self.charge - used_wh / law.capacity_wh, 0.0)
        self._tell(dt_s)

    def _tell(self, dt_s: float) -> None:
        self._time_s += dt_s
        self._late.append((self._time_s, self.charge))
        while self._time_s - self._late[0][0] > _DELAY_S:
            self._late.popleft()
        if self.word == "delayed":
            self.told = self._late[0][1]
        elif self.word != "slow" or self._time_s - self._told_s > _SLOW_S:
            self.told, self._told_s = self.charge, self._time_s

    @property
    def cell_v(self) -> float:
        """Voltage of one cell under load."""
        sag = 0.08 * self.power_w / max(self._battery.hover_w, 1.0)
        return _EMPTY_V + (_FULL_V - _EMPTY_V) * self.charge - sag

    @property
    def pack_v(self) -> float:
        """Voltage of the pack."""
        return _CELLS * self.cell_v

    @property
    def current_a(self) -> float:
        """Current drawn."""
        return self.power_w / max(self.pack_v, 1.0)

    @property
    def cells(self) -> int:
        """Cells in series."""
        return _CELLS
