"""What a ground station on the vehicle's own radio is shown: health, phases, events, photos."""

from __future__ import annotations

import math
import time
from datetime import datetime

from drivers.autopilot_announcer import Announcer, Health, Level, PhotoPlace
from mission.flight.command import MissionState, Phase, Progress
from mission.flight.events import EventRecord, Reaction
from mission.flight.observation import Observation
from mission.processes.flight_inputs import FlightInputs
from mission.processes.preflight import WORKERS
from mission.remote.messages import PhotoTakenMessage

HEARTBEAT_S = 1.0
#: A scan older than this while flying means that we see nothing.
BLIND_S = 1.0
#: Between missions only one scan a second is looked at.
RESTING_BLIND_S = 3.0
_RUNNING = (MissionState.RUNNING, MissionState.PAUSED)
_NAME = "bladescout"


def health_of(
    progress: Progress, observation: Observation, inputs: FlightInputs, now_s: float
) -> Health:
    """Return how the daemon is: what is needed for flying works, or does not.

    ``now_s``: mission time.
    """
    sensing = inputs.sensing
    if not inputs.ready.issuperset(WORKERS):
        return Health.BOOT
    flying = progress.state in _RUNNING
    allowed_s = BLIND_S if flying else RESTING_BLIND_S
    blind = observation.clearance is None or now_s - observation.clearance.stamp_s > allowed_s
    seeing = sensing is not None and sensing.lidar_online and sensing.camera_online
    if not observation.sensing_alive or not seeing or blind:
        return Health.CRITICAL
    return Health.ACTIVE if flying else Health.STANDBY


class Announcements:
    """Turns what flight does into heartbeats, sentences and photo marks."""

    def __init__(self, announcer: Announcer, *, photos: bool) -> None:
        """``photos``: tell them, too; the camera does so itself where it shares the link."""
        self._announcer = announcer
        self._photos = photos
        self._heartbeat_s = float("-inf")
        self._phase = Phase.IDLE
        self._state = MissionState.IDLE

    def tick(self, progress: Progress, observation: Observation, inputs: FlightInputs) -> None:
        """Tell what is due; called every tick."""
        now_s = time.monotonic()
        if now_s - self._heartbeat_s >= HEARTBEAT_S:
            self._heartbeat_s = now_s
            self._announcer.heartbeat(health_of(progress, observation, inputs, observation.now_s))
        if (progress.phase, progress.state) == (self._phase, self._state):
            return
        self._phase, self._state = progress.phase, progress.state
        where = f" {progress.blade} {progress.side}" if progress.blade else ""
        over = progress.state not in (*_RUNNING, MissionState.IDLE)
        what = f"{progress.state}" if over else f"{progress.phase}{where}"
        self._announcer.say(Level.NOTICE, f"{_NAME}: {what}: {progress.words}")

    def events(self, events: tuple[EventRecord, ...]) -> None:
        """Tell what makes the flight hold, leave or end."""
        for event in events:
            if event.severity >= Reaction.HOLD:
                level = Level.WARNING if event.severity is Reaction.HOLD else Level.CRITICAL
                self._announcer.say(level, f"{_NAME}: {event.text}")

    def photo(self, taken: PhotoTakenMessage) -> None:
        """Tell of a photo, where its place on the globe is known."""
        place = taken.latitude_deg, taken.longitude_deg, taken.altitude_m
        if not self._photos or None in place:
            return
        latitude_deg, longitude_deg, altitude_m = (value or 0.0 for value in place)
        self._announcer.photo(
            PhotoPlace(
                index=taken.index,
                boot_ms=int(taken.stamp_s * 1e3),
                utc_us=int(datetime.fromisoformat(taken.utc).timestamp() * 1e6),
                latitude_deg=latitude_deg,
                longitude_deg=longitude_deg,
                altitude_m=altitude_m,
                height_m=taken.position_w[2] if taken.height_m is None else taken.height_m,
                quaternion=_quaternion_ned(taken.gimbal_yaw_rad, taken.gimbal_pitch_rad),
                url=taken.url,
            )
        )


def _quaternion_ned(yaw_enu_rad: float, pitch_rad: float) -> tuple[float, float, float, float]:
    """Return w x y z of yaw and pitch, from ENU yaw (0 east) and pitch positive up."""
    yaw, pitch = math.pi / 2 - yaw_enu_rad, pitch_rad
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    return (cy * cp, -sy * sp, cy * sp, sy * cp)
