"""Camera and gimbal of the tracking bench: the field's gimbal, and a camera without pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from config.settings import Settings
from drivers.simulated.aircraft import TICK_S, Aircraft
from drivers.simulated.mavlink_gimbal import MockGimbal
from mission.flight.command import GimbalAim, PhotoCommand
from mission.flight.observation import GimbalState, Vec3
from perception.geometry import rotation_from_quaternion, wrap_angle
from perception.values import Float

#: From the command over the link to the shutter, and until the photo is confirmed.
SHUTTER_LAG_S = 0.07
STORE_S = 0.3
JUDGED_S = 1.0
_YAW_LOCK = 16


@dataclass(frozen=True, slots=True)
class _Order:
    """An aim as the gimbal's manager is told it (GIMBAL_MANAGER_SET_PITCHYAW)."""

    pitch: float
    yaw: float
    flags: int = _YAW_LOCK

    def get_type(self) -> str:
        return "GIMBAL_MANAGER_SET_PITCHYAW"

    def pack(self, _mav: object) -> bytes:
        return b""

    def get_srcSystem(self) -> int:  # noqa: N802 - pymavlink's own name
        return 0

    def get_srcComponent(self) -> int:  # noqa: N802 - pymavlink's own name
        return 0


@dataclass(frozen=True, slots=True, eq=False)
class Still:
    """A photo and the truth of its moment. World: the scene's."""

    command: PhotoCommand
    t_s: float
    eye_w: Float
    rotation_wc: Float
    velocity_w: Vec3
    camera_rate_rps: float
    shutter_s: float


class Payload:
    """What hangs below the aircraft, stepped with it."""

    def __init__(self, settings: Settings, aircraft: Aircraft, seed: int) -> None:
        self._aircraft = aircraft
        self._offset_b = np.asarray(settings.camera.offset_m)
        self._interval_s = settings.camera.min_interval_s
        self._gimbal = MockGimbal(
            settings.gimbal, 1, lambda _message, _component: None, aircraft.telemetry, seed
        )
        self._pending: tuple[PhotoCommand, float] | None = None
        self._last_s = float("-inf")
        self._waiting: list[Still] = []
        self.shutter_s = settings.camera.shutter_s
        self.stills: list[Still] = []
        self.last_photo_id = self.failed_photo_id = -1
        self.gimbal_state: GimbalState | None = None

    def aim(self, aim: GimbalAim) -> None:
        """Take an aim: ENU yaw and pitch, as flight gives it."""
        self._gimbal.handle(_Order(aim.pitch_rad, wrap_angle(np.pi / 2 - aim.yaw_rad)))

    def shoot(self, command: PhotoCommand, now_s: float) -> None:
        """Take an order for a photo."""
        if self._pending is not None or now_s - self._last_s < self._interval_s:
            self.failed_photo_id = command.photo_id
            return
        self._pending, self._last_s = (command, now_s + SHUTTER_LAG_S), now_s

    def step(self, now_s: float) -> None:
        """Advance to ``now_s``: move the gimbal, open the shutter, confirm."""
        aircraft, gimbal = self._aircraft, self._gimbal
        gimbal.step(TICK_S)
        truth = gimbal.truth(aircraft.body.yaw_rad, TICK_S)
        if self._pending is not None and now_s >= self._pending[1]:
            body = rotation_from_quaternion(aircraft.quaternion_wb)
            still = Still(
                command=self._pending[0],
                t_s=now_s,
                eye_w=np.asarray(aircraft.body.position_w) + body @ self._offset_b,
                rotation_wc=rotation_from_quaternion(truth.quaternion_wc),
                velocity_w=aircraft.body.velocity_w,
                camera_rate_rps=truth.rate_rps,
                shutter_s=self.shutter_s,
            )
            self._pending = None
            self.stills.append(still)
            self._waiting.append(still)
        if self._waiting and now_s >= self._waiting[0].t_s + STORE_S:
            self.last_photo_id = self._waiting.pop(0).command.photo_id

    def report(self, now_s: float, believed_yaw_rad: float) -> GimbalState:
        """Return what the gimbal says of itself: against the believed heading."""
        yaw = wrap_angle(believed_yaw_rad - self._gimbal.yaw_rad)
        return GimbalState(now_s, yaw, self._gimbal.pitch_rad)
