"""Every two seconds along a blade: how far the whole turbine stands from where it was measured.

Scans of a second are joined and laid on the measured turbine (`perception.turbine_sighting`). A
guess is carried along from one sighting to the next (`perception.frame_drift`), so that far parts
are looked for where they are.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from config.photos import Positioning
from config.turbine import Turbine
from mission.flight.command import SensingTask
from mission.flight.observation import TurbineSeen, Vec3
from mission.flight.rotor_model import MeasuredBlade, rotor_model
from perception.frame_drift import FrameDrift, turned
from perception.geometry import vec3
from perception.turbine_sighting import TurbineSolid, near_turbine, sight_turbine
from perception.values import Float

WINDOW_S, EVERY_S = 1.0, 2.0
#: Of a scan, at most so many returns near the turbine are kept.
MOST_POINTS = 1500
#: How far the measured hub may be off, per axis.
ROTOR_SIGMA_M = 0.4
#: Sightings that follow each other err alike: each counts as a share of one. And what is common to
#: all of them.
REPEATED, COMMON_SIGMA_M = 2.0, 0.05


class TurbineSight:
    """Remembers a second of returns, and where the turbine was seen last."""

    def __init__(self, positioning: Positioning, heading_sigma_deg: float = 1.0) -> None:
        self._positioning = positioning
        self._heading_rad = math.radians(heading_sigma_deg)
        self._measured: tuple[float, Vec3] | None = None
        self._solid: TurbineSolid | None = None
        self._drift: FrameDrift | None = None
        self._recent: deque[tuple[float, Float]] = deque()
        self._told_s = -math.inf

    def take(
        self,
        task: SensingTask,
        turbine: Turbine | None,
        points_w: Float,
        stamp_s: float,
        position_w: Float,
        velocity_w: Float,
    ) -> TurbineSeen | None:
        """Take one scan, (N, 3) world metres; return the turbine every two seconds, if seen."""
        if turbine is None or not self._known(task, turbine):
            return None
        solid, drift = self._solid, self._drift
        if solid is None or drift is None:
            return None
        drift.move(stamp_s, position_w, velocity_w)
        guess = drift.at(stamp_s)[0]
        near = points_w[near_turbine(points_w - guess, solid)]
        self._recent.append((stamp_s, near[:: max(1, -(-len(near) // MOST_POINTS))]))
        while self._recent and stamp_s - self._recent[0][0] > WINDOW_S:
            self._recent.popleft()
        if stamp_s - self._told_s < EVERY_S:
            return None
        self._told_s = stamp_s
        joined = np.concatenate([points for _, points in self._recent])
        sighting = sight_turbine(joined, position_w, solid, guess)
        if sighting is None:
            return None
        sigma_m = math.hypot(COMMON_SIGMA_M, self._positioning.noise_sigma_m)
        common = np.diag([sigma_m**2] * 3 + [0.0])
        spread = REPEATED * sighting.covariance + common
        drift.see(stamp_s, np.append(sighting.offset_w, sighting.heading_rad), spread)
        told = tuple(float(value) for value in spread[np.triu_indices(4)])
        return TurbineSeen(stamp_s, vec3(sighting.offset_w), sighting.heading_rad, told)

    def appears_moved(self, places_w: Float, stamp_s: float, position_w: Float) -> Float:
        """Return how far (N, 3) places (N, 3) of the measured turbine appear moved by now."""
        if self._drift is None:
            return np.zeros_like(places_w)
        heading_rad, _ = self._drift.heading(stamp_s)
        drift_w, _ = self._drift.at(stamp_s)
        return drift_w + turned(heading_rad, places_w - position_w)

    def _known(self, task: SensingTask, turbine: Turbine) -> bool:
        """Return whether a task tells a measured rotor; take it where it is another one."""
        if task.hub_w is None or task.normal_w is None or task.measured_s is None:
            return False
        measured = (task.measured_s, task.hub_w)
        if measured != self._measured:
            self._measured = measured
            blades = [
                MeasuredBlade(blade.name, blade.direction_w, blade.pitch_deg)
                for blade in task.blades
            ]
            hub_w, normal_w = np.array(task.hub_w), np.array(task.normal_w)
            self._solid = rotor_model(hub_w, normal_w, blades, turbine).solid()
            known = self._positioning
            self._drift = FrameDrift(
                known.wander_sigma_m, known.wander_s, task.measured_s, ROTOR_SIGMA_M,
                self._heading_rad,
            )  # fmt: skip
            self._recent.clear()
        return True
