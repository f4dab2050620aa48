"""The watch: which events are active at a tick, from the observation alone and a little memory."""

from __future__ import annotations

import math
from collections import deque

from config.energy import must_return_at
from mission.flight.command import Phase
from mission.flight.events import Event
from mission.flight.flight import Flight
from mission.flight.observation import Observation, Vehicle
from mission.flight.rotor_watch import RotorWatch
from perception.rotor import RefusalCode

SCAN_LOST_S = 10.0
SENSING_LOST_S = 20.0
DEATHS, DEATHS_WITHIN_S = 3, 60.0
LINK_S = (1.0, 3.0, 10.0)
HEARTBEAT_EXTRA_S = 1.0
#: After so long without a tick it is we who did not listen.
OWN_STALL_S = 1.0
POSITION_STALE_S = 0.5
JUMP_M = 1.5
#: A slower run-off is told over this time: so far from what the velocity explains.
RUN_OFF_S = 1.0
RUN_OFF_M = 2.0
#: Heading against gyro: a filter corrects its heading by so much within this time, and no more.
HEADING_S = 5.0
HEADING_OFF_RAD, HEADING_BACK_RAD = math.radians(5.0), math.radians(2.5)
WIND_MEAN_S = 5.0
CAMERA_LOST_S = 10.0
EXPOSURE_OLD_S, EXPOSURE_STALE_S = 0.5, 2.0
BLOCKED_S = 20.0

#: Phases in which the vehicle is flown near or towards the turbine.
SENSING_PHASES = frozenset({Phase.ASCEND, Phase.APPROACH, Phase.ESTIMATE, Phase.TRACK, Phase.HOLD})


class Watch:
    """Remembers since when, so that durations can be told."""

    def __init__(self) -> None:
        self._since: dict[str, float] = {}
        self._ticked_s = -math.inf
        self._awake_s = -math.inf
        """Since when ticks come without a stall of our own."""
        self._wind: deque[tuple[float, float]] = deque()
        self._last: Vehicle | None = None
        self._astray: deque[tuple[float, float, float, float]] = deque()
        self._headings: deque[tuple[float, float]] = deque()
        self._heading_was: float | None = None
        """Heading minus gyro from before the heading went wrong; None: it is right."""
        self._resets: int | None = None
        self._deaths: deque[float] = deque()
        self._alive = True
        self._rotor_watch = RotorWatch()

    def update(self, flight: Flight, phase: Phase) -> set[Event]:
        """Return every event that is active at this tick."""
        observation = flight.observation
        if observation.now_s - self._ticked_s > OWN_STALL_S:
            self._awake_s = observation.now_s
        self._ticked_s = observation.now_s
        active = set(flight.raised)
        flight.raised.clear()
        if observation.vehicle is not None:
            active |= self._vehicle(flight, observation, observation.vehicle)
        if phase in SENSING_PHASES:
            active |= self._scans(flight, observation)
            active |= self._rotor(observation)
        if phase is Phase.TRACK or phase is Phase.HOLD:
            active |= self._camera(flight, observation)
        if phase is Phase.TRACK and self._rotor_watch.moved(flight):
            active.add(Event.ROTOR_MOVED)
        active |= self._guard(observation)
        return active

    def _lasting(self, name: str, active: bool, now_s: float) -> float:
        """Return for how long something has been so."""
        if not active:
            self._since.pop(name, None)
            return 0.0
        return now_s - self._since.setdefault(name, now_s)

    def _vehicle(self, flight: Flight, observation: Observation, vehicle: Vehicle) -> set[Event]:
        now, active = observation.now_s, set()
        heard = max(vehicle.stamp_s, vehicle.heartbeat_stamp_s - HEARTBEAT_EXTRA_S)
        # What came while we stood still is read only now: that was no silence of the link.
        silent = now - max(heard, self._awake_s)
        for limit, event in zip(
            LINK_S, (Event.LINK_AGEING, Event.LINK_SILENT, Event.LINK_LOST), strict=True
        ):
            if silent > limit:
                active.add(event)
        if now - vehicle.stamp_s > POSITION_STALE_S:
            active.add(Event.POSITION_STALE)
        step_s = 0.0 if self._last is None else vehicle.stamp_s - self._last.stamp_s
        # Over a gap nobody can tell a jump from a manoeuvre.
        if self._last is not None and 0.0 < step_s < POSITION_STALE_S and flight.engaged:
            expected = [
                p + step_s * (v + w) / 2
                for p, v, w in zip(
                    self._last.position_w, self._last.velocity_w, vehicle.velocity_w, strict=True
                )
            ]
            if math.dist(expected, vehicle.position_w) > JUMP_M + 0.5 * step_s:
                active.add(Event.POSITION_JUMP)
            off = [a - b for a, b in zip(vehicle.position_w, expected, strict=True)]
            if self._runs_off(vehicle.stamp_s, off):
                active.add(Event.POSITION_JUMP)
        if self._resets is not None and vehicle.reset_count != self._resets and flight.engaged:
            active.add(Event.FRAME_RESET)
        if not flight.engaged:
            self._headings.clear()
            self._heading_was = None
        elif self._heading_wrong(vehicle):
            active.add(Event.HEADING_WRONG)
        self._last, self._resets = vehicle, vehicle.reset_count
        active |= self._wind_events(flight, vehicle, now)
        # Where nothing at all is heard, that is the fault, and not the battery's.
        if flight.engaged and silent <= LINK_S[0]:
            active |= self._battery(flight, vehicle, now)
        return active

    def _runs_off(self, stamp_s: float, off: list[float]) -> bool:
        """Return whether the position left, within a second, where its own velocity leads."""
        self._astray.append((stamp_s, off[0], off[1], off[2]))
        while stamp_s - self._astray[0][0] > RUN_OFF_S:
            self._astray.popleft()
        return math.hypot(*(sum(part[k] for part in self._astray) for k in (1, 2, 3))) > RUN_OFF_M

    def _heading_wrong(self, vehicle: Vehicle) -> bool:
        """Return whether the heading turned, within seconds, where the gyro did not (or back)."""
        if vehicle.gyro_yaw_rad is None:
            return False
        off = math.remainder(vehicle.yaw_rad - vehicle.gyro_yaw_rad, 2 * math.pi)
        self._headings.append((vehicle.stamp_s, off))
        while vehicle.stamp_s - self._headings[0][0] > HEADING_S:
            self._headings.popleft()
        was = self._heading_was
        limit = HEADING_OFF_RAD if was is None else HEADING_BACK_RAD
        before = self._headings[0][1] if was is None else was
        wrong = abs(math.remainder(off - before, 2 * math.pi)) > limit
        if was is not None and not wrong:
            # What was wrong meanwhile says nothing of what comes.
            self._headings.clear()
        self._heading_was = before if wrong else None
        return wrong

    def _wind_events(self, flight: Flight, vehicle: Vehicle, now: float) -> set[Event]:
        if vehicle.wind_w is None:
            return set()
        bounds = flight.settings.guard
        speed = math.hypot(vehicle.wind_w[0], vehicle.wind_w[1])
        self._wind.append((now, speed))
        while self._wind and now - self._wind[0][0] > WIND_MEAN_S:
            self._wind.popleft()
        full = now - self._wind[0][0] > 0.9 * WIND_MEAN_S
        mean = sum(s for _, s in self._wind) / len(self._wind)
        strong = speed > bounds.max_gust_mps or (full and mean > bounds.max_wind_mps)
        return {Event.WIND_STRONG} if strong else set()

    def _battery(self, flight: Flight, vehicle: Vehicle, now: float) -> set[Event]:
        battery = flight.settings.battery
        heard = max(vehicle.battery_stamp_s, self._awake_s)
        aged = now - heard > battery.telemetry_timeout_s
        if vehicle.battery is None and not flight.settings.autopilot.strict:
            return set()
        if vehicle.battery is None or aged:
            return {Event.BATTERY_UNKNOWN}
        # The way home leads round the rotor: the tip's height is on it only from above the hub.
        needed = must_return_at(
            battery,
            flight.settings.airframe,
            vehicle.position_w,
            flight.goal_w,
            vehicle.position_w[2],
            vehicle.wind_w or (0.0, 0.0, 0.0),
        )
        return {Event.BATTERY_RESERVE} if vehicle.battery < needed + 0.02 else set()

    def _scans(self, flight: Flight, observation: Observation) -> set[Event]:
        now, active, bounds = observation.now_s, set(), flight.settings.guard
        if self._alive and not observation.sensing_alive:
            self._deaths.append(now)
        self._alive = observation.sensing_alive
        while self._deaths and now - self._deaths[0] > DEATHS_WITHIN_S:
            self._deaths.popleft()
        dead_s = self._lasting("sensing", not observation.sensing_alive, now)
        if not observation.sensing_alive:
            active.add(Event.SENSING_DEAD)
        if dead_s > SENSING_LOST_S or len(self._deaths) >= DEATHS:
            active.add(Event.SENSING_LOST)
        scan = observation.clearance
        age = math.inf if scan is None else now - scan.stamp_s
        late_s = self._lasting("scan", age > bounds.scan_hold_s, now)
        if age > bounds.scan_hold_s:
            active.add(Event.SCAN_LATE)
        elif age > bounds.scan_warn_s:
            active.add(Event.SCAN_AGEING)
        if late_s > SCAN_LOST_S - bounds.scan_hold_s:
            active.add(Event.SCAN_LOST)
        if scan is not None and scan.repeated:
            active.add(Event.SCAN_REPEATED)
        if scan is not None and scan.scan_rate_hz < 3.5:
            active.add(Event.SCAN_TOO_SLOW)
        elif scan is not None and scan.scan_rate_hz < 8.0:
            active.add(Event.SCAN_SLOW)
        return active

    def _rotor(self, observation: Observation) -> set[Event]:
        prior, rotor = observation.hub_prior, observation.rotor
        seen = prior is not None and prior.turning is True
        recent = rotor is not None and observation.now_s - rotor.stamp_s < 5.0
        if rotor is not None and recent and rotor.refusal == RefusalCode.ROTOR_TURNING:
            seen = True
        return {Event.ROTOR_TURNING} if seen else set()

    def _camera(self, flight: Flight, observation: Observation) -> set[Event]:
        now, active = observation.now_s, set()
        camera, gimbal, exposure = observation.camera, observation.gimbal, observation.exposure
        offline = camera is None or not camera.online
        gone_s = self._lasting("camera", offline, now)
        if offline:
            active.add(Event.CAMERA_LOST if gone_s > CAMERA_LOST_S else Event.CAMERA_OFFLINE)
        if gimbal is None or now - gimbal.stamp_s > 1.0:
            active.add(Event.GIMBAL_SILENT)
        # Between two passes no blade is before the camera.
        dark = flight.on_leg and exposure is not None and now - exposure.stamp_s > EXPOSURE_OLD_S
        if self._lasting("exposure", dark, now) > EXPOSURE_STALE_S:
            active.add(Event.EXPOSURE_STALE)
        return active

    def _guard(self, observation: Observation) -> set[Event]:
        refused = bool(observation.guard_refused)
        lasting = self._lasting("guard", refused, observation.now_s)
        if not refused:
            return set()
        return {Event.GUARD_REFUSED} | ({Event.GUARD_BLOCKED} if lasting > BLOCKED_S else set())
