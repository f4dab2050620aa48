"""How much a photo taken now would be blurred, from what the vehicle and the gimbal report.

While the shutter is open the picture moves by the vehicle's speed across the sight and by the
camera's own turning (wind turns the airframe, the gimbal follows). The two are added as if they
went the same way: the worst case, and what a judge of the photo would do.
"""

from __future__ import annotations

import math

import numpy as np

from config.settings import Settings
from mission.flight.observation import CameraState, GimbalState, Observation
from perception.geometry import wrap_angle
from perception.values import Float

#: The turning is measured over at least this long: reports come 30 times a second.
RATE_OVER_S = 0.06
STALE_S = 0.5


def shutter_s(camera: CameraState | None, settings: Settings) -> float:
    """Return the exposure time that the camera reports, else the one asked of it."""
    told = None if camera is None else camera.shutter_s
    return settings.camera.shutter_s if told is None else told


def pixels_per_rad(settings: Settings) -> float:
    """Return the focal length in pixels of the full picture."""
    camera = settings.camera
    return camera.focal_length_mm / camera.sensor_width_mm * camera.width_px


def sight_w(gimbal: GimbalState) -> Float:
    """Return the unit direction (3,) of the optical axis."""
    flat = math.cos(gimbal.pitch_rad)
    return np.array(
        [
            flat * math.cos(gimbal.yaw_rad),
            flat * math.sin(gimbal.yaw_rad),
            math.sin(gimbal.pitch_rad),
        ]
    )


class Motion:
    """Remembers the gimbal's last reports, so that its rate can be told."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._reports: list[GimbalState] = []

    def take(self, observation: Observation) -> None:
        """Take the tick's report."""
        gimbal = observation.gimbal
        if gimbal is None or (self._reports and gimbal.stamp_s <= self._reports[-1].stamp_s):
            return
        self._reports = [*self._reports[-5:], gimbal]

    @property
    def rate_rps(self) -> float:
        """How fast the optical axis turns; 0 while it is not known."""
        if len(self._reports) < 2:
            return 0.0
        newest = self._reports[-1]
        older = [r for r in self._reports[:-1] if newest.stamp_s - r.stamp_s >= RATE_OVER_S]
        before = older[-1] if older else self._reports[0]
        apart_s = newest.stamp_s - before.stamp_s
        if apart_s > STALE_S:
            return 0.0
        yaw = wrap_angle(newest.yaw_rad - before.yaw_rad) * math.cos(newest.pitch_rad)
        return math.hypot(yaw, newest.pitch_rad - before.pitch_rad) / apart_s

    def blur_px(self, observation: Observation, range_m: float) -> float:
        """Return the blur of a photo taken now, in pixels of the full picture.

        ``range_m``: of the skin that it shows.
        """
        vehicle, gimbal = observation.vehicle, observation.gimbal
        if vehicle is None or gimbal is None:
            return math.inf
        sight, velocity = sight_w(gimbal), np.array(vehicle.velocity_w)
        across = float(np.linalg.norm(velocity - (velocity @ sight) * sight))
        turning = self.rate_rps + across / max(range_m, 1.0)
        return (
            turning * shutter_s(observation.camera, self._settings) * pixels_per_rad(self._settings)
        )
