"""What the autopilot reports, gathered from its messages and turned to ENU/FLU mission values."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import StrEnum

from drivers.autopilot_texts import StatusText, StatusTexts
from drivers.autopilot_wire import Received
from drivers.clock import Clock
from drivers.frames import (
    Quaternion,
    Vec3,
    swap_attitude,
    swap_enu_ned,
    yaw_of,
)
from drivers.stamps import MinimumOffset
from perception.geometry import quaternion_from_euler

_NEVER = float("-inf")
_ARMED = 0x80
_PREARM_CHECK = 0x10000000
_RC_RECEIVER = 0x00010000
#: MAV_STATE standby, active.
_STANDING_BY = (3, 4)
_LANDED_ON_GROUND = 1
_LANDED_FLYING = (2, 3, 4)
_MAIN_AUTO, _MAIN_OFFBOARD = 4, 6

#: A step of the local position that its own velocity does not explain is a reset of the frame.
_RESET_STEP_M = 0.8
_RESET_INTERVAL_S = 0.5
_SAME_RESET_S = 1.0
#: So high above its home a vehicle without a landed state is taken to fly.
_HIGH_M = 1.0
#: Over a longer gap between two attitudes the gyro is not integrated.
_GYRO_GAP_S = 0.5
#: The rate of the positions is that of so many.
_RATE_OF = 6


class VehicleMode(StrEnum):
    """Modes that matter here; the strings of the mission's `FlightMode`."""

    OFFBOARD = "offboard"
    HOLD = "hold"
    TAKEOFF = "takeoff"
    LAND = "land"
    RETURN = "return"
    PILOT = "pilot"
    UNKNOWN = "unknown"


_AUTO_MODES = {
    2: VehicleMode.TAKEOFF,
    3: VehicleMode.HOLD,
    5: VehicleMode.RETURN,
    6: VehicleMode.LAND,
    9: VehicleMode.LAND,  # precision landing
}


def mode_of(custom_mode: int) -> VehicleMode:
    """Return the mode of a PX4 custom mode; whatever we do not fly ourselves is the pilot's."""
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    if main == _MAIN_OFFBOARD:
        return VehicleMode.OFFBOARD
    if main == _MAIN_AUTO:
        return _AUTO_MODES.get(sub, VehicleMode.PILOT)
    return VehicleMode.PILOT if main else VehicleMode.UNKNOWN


@dataclass(frozen=True, slots=True)
class VehicleReading:
    """The vehicle as reported; the field names are those of the mission's `Vehicle`.

    World is the autopilot's local frame turned to ENU, metres; body FLU; stamps are mission
    seconds, -inf for what never came.
    """

    stamp_s: float
    """Of the newest position, by the autopilot's own time stamp."""
    position_w: Vec3
    velocity_w: Vec3
    quaternion_wb: Quaternion
    yaw_rad: float
    mode: VehicleMode
    mode_stamp_s: float
    armed: bool
    in_air: bool
    landed: bool
    heartbeat_stamp_s: float
    attitude_stamp_s: float = _NEVER
    battery: float | None = None
    battery_stamp_s: float = _NEVER
    wind_w: Vec3 | None = None
    home_w: Vec3 | None = None
    healthy: bool = False
    reset_count: int = 0
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    altitude_m: float | None = None
    gps_fix: int | None = None
    """GPS_FIX_TYPE: 3 is 3D, 6 is RTK fixed."""
    gps_eph_m: float | None = None
    """Horizontal accuracy; the dilution of precision where the receiver gives no metres."""
    satellites: int | None = None
    rc_link: bool | None = None
    """A radio-control receiver is present and healthy."""
    intended: VehicleMode | None = None
    """What somebody last asked for, where the vehicle tells it: in a failsafe not the mode."""
    position_hz: float | None = None
    """How often the position comes, of the last few; None before there are as many."""
    gyro_yaw_rad: float | None = None
    """The heading as the gyro alone carries it on from the first one; None: no rates are told."""


class VehicleState:
    """Newest of every message, kept by MAVSDK's thread and read by the tick.

    Each attribute is replaced whole, so that a reader never sees half a message.
    """

    MESSAGES = (
        "HEARTBEAT",
        "CURRENT_MODE",
        "LOCAL_POSITION_NED",
        "ATTITUDE_QUATERNION",
        "GLOBAL_POSITION_INT",
        "EXTENDED_SYS_STATE",
        "SYS_STATUS",
        "BATTERY_STATUS",
        "WIND_COV",
        "HOME_POSITION",
        "GPS_RAW_INT",
        "ODOMETRY",
        "STATUSTEXT",
    )

    EULER_ATTITUDE = "ATTITUDE"
    """What tells the attitude of a vehicle that sends no quaternion; twice as often as wanted."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._boot = MinimumOffset(window_s=5.0)
        self._position: tuple[float, float, Vec3, Vec3] | None = None
        self._position_times_s: deque[float] = deque(maxlen=_RATE_OF)
        self._attitude: tuple[float, Quaternion] | None = None
        self.has_quaternion = False
        """The vehicle tells its attitude by quaternion."""
        self._gyro: tuple[float, float, float, float] | None = None
        """Stamp, heading, the gyro's heading and its rate."""
        self._geodetic: Vec3 | None = None
        self._armed = False
        self._heartbeat_s = _NEVER
        self._mode = (VehicleMode.UNKNOWN, _NEVER)
        self._intended: VehicleMode | None = None
        self._landed_state: int | None = None
        self._battery: tuple[float, float] | None = None
        self._has_battery_status = False
        self._wind: Vec3 | None = None
        self._home: Vec3 | None = None
        self._home_altitude_m: float | None = None
        self._standing_by = False
        self._healthy: bool | None = None
        self._rc_link: bool | None = None
        self._gps: tuple[int, float | None, int | None] | None = None
        self._resets = 0
        self._odometry_reset: int | None = None
        self._stepped_s = _NEVER
        self._texts = StatusTexts()
        self._takers = {
            "HEARTBEAT": self._take_heartbeat,
            "CURRENT_MODE": self._take_current_mode,
            "LOCAL_POSITION_NED": self._take_position,
            "ATTITUDE_QUATERNION": self._take_attitude,
            self.EULER_ATTITUDE: self._take_euler_attitude,
            "GLOBAL_POSITION_INT": self._take_geodetic,
            "EXTENDED_SYS_STATE": self._take_landed_state,
            "SYS_STATUS": self._take_system_status,
            "BATTERY_STATUS": self._take_battery,
            "WIND_COV": self._take_wind,
            "HOME_POSITION": self._take_home,
            "GPS_RAW_INT": self._take_gps,
            "ODOMETRY": self._take_odometry,
            "STATUSTEXT": self._take_text,
        }

    def take(self, message: Received) -> None:
        """Keep what one message says."""
        self._takers[message.name](message)

    def reading(self) -> VehicleReading | None:
        """Return the newest of everything; None until mode, position and attitude are known."""
        position, attitude = self._position, self._attitude
        if position is None or attitude is None or self._heartbeat_s == _NEVER:
            return None
        stamp_s, _, position_w, velocity_w = position
        attitude_stamp_s, quaternion_wb = attitude
        mode, mode_stamp_s = self._mode
        battery, battery_stamp_s = self._battery or (None, _NEVER)
        latitude, longitude, altitude = self._geodetic or (None, None, None)
        gps_fix, gps_eph_m, satellites = self._gps or (None, None, None)
        return VehicleReading(
            stamp_s=stamp_s,
            position_w=position_w,
            velocity_w=velocity_w,
            quaternion_wb=quaternion_wb,
            yaw_rad=yaw_of(quaternion_wb),
            mode=mode,
            mode_stamp_s=mode_stamp_s,
            armed=self._armed,
            in_air=self._flies(position_w),
            landed=self._stands(position_w),
            heartbeat_stamp_s=self._heartbeat_s,
            attitude_stamp_s=attitude_stamp_s,
            battery=battery,
            battery_stamp_s=battery_stamp_s,
            wind_w=self._wind,
            home_w=self._home,
            healthy=self._standing_by if self._healthy is None else self._healthy,
            reset_count=self._resets,
            latitude_deg=latitude,
            longitude_deg=longitude,
            altitude_m=altitude,
            gps_fix=gps_fix,
            gps_eph_m=gps_eph_m,
            satellites=satellites,
            rc_link=self._rc_link,
            intended=self._intended,
            position_hz=self._position_hz(),
            gyro_yaw_rad=None if self._gyro is None else self._gyro[2],
        )

    def _flies(self, position_w: Vec3) -> bool:
        if self._landed_state is not None:
            return self._landed_state in _LANDED_FLYING
        return self._armed and self._high(position_w)

    def _stands(self, position_w: Vec3) -> bool:
        if self._landed_state is not None:
            return self._landed_state == _LANDED_ON_GROUND
        return not self._armed and not self._high(position_w)

    def _high(self, position_w: Vec3) -> bool:
        """Return whether a vehicle that does not tell whether it has landed is above its home."""
        return position_w[2] - (0.0 if self._home is None else self._home[2]) > _HIGH_M

    def _position_hz(self) -> float | None:
        times_s = tuple(self._position_times_s)
        span_s = times_s[-1] - times_s[0] if len(times_s) == _RATE_OF else 0.0
        return (_RATE_OF - 1) / span_s if span_s > 0 else None

    def texts(self) -> tuple[StatusText, ...]:
        """Return the autopilot's newest sentences, oldest first (at most 50)."""
        return self._texts.newest

    @property
    def mode(self) -> VehicleMode:
        """The newest mode reported."""
        return self._mode[0]

    @property
    def altitude_m(self) -> float | None:
        """Height above mean sea level, once known."""
        if self._geodetic is not None:
            return self._geodetic[2]
        if self._home is None or self._home_altitude_m is None or self._position is None:
            return None
        return self._home_altitude_m + self._position[2][2] - self._home[2]

    @property
    def heartbeat_stamp_s(self) -> float:
        """Mission time of the newest heartbeat, -inf before the first."""
        return self._heartbeat_s

    def _arrival_s(self, message: Received) -> float:
        return self._clock.mission_time_of(message.arrival_ns)

    def _boot_stamp(self, message: Received) -> tuple[float, float]:
        """Return (mission stamp, seconds since boot) of a message that carries its own time."""
        boot_s = message.number("time_boot_ms") * 1e-3
        return self._boot.map(boot_s, self._arrival_s(message)), boot_s

    def _take_heartbeat(self, message: Received) -> None:
        arrival_s = self._arrival_s(message)
        self._armed = bool(message.integer("base_mode") & _ARMED)
        self._standing_by = message.integer("system_status") in _STANDING_BY
        mode = mode_of(message.integer("custom_mode"))
        if mode is not self._mode[0]:
            # What was told of the mode before says nothing of who has asked for this one.
            self._intended = None
        self._mode = (mode, arrival_s)
        self._heartbeat_s = arrival_s

    def _take_current_mode(self, message: Received) -> None:
        self._mode = (mode_of(message.integer("custom_mode")), self._arrival_s(message))
        # Zero: not known.
        intended = message.integer("intended_custom_mode")
        self._intended = mode_of(intended) if intended else None

    def _take_position(self, message: Received) -> None:
        north_up = (message.number("x"), message.number("y"), message.number("z"))
        moving = (message.number("vx"), message.number("vy"), message.number("vz"))
        if not all(map(math.isfinite, north_up + moving)):
            return
        position_w, velocity_w = swap_enu_ned(north_up), swap_enu_ned(moving)
        stamp_s, boot_s = self._boot_stamp(message)
        if self._position is not None:
            self._watch_for_step(boot_s, position_w, velocity_w)
        self._position = (stamp_s, boot_s, position_w, velocity_w)
        self._position_times_s.append(stamp_s)

    def _watch_for_step(self, boot_s: float, position_w: Vec3, velocity_w: Vec3) -> None:
        """Count a reset where the position stepped further than its velocity explains."""
        if self._position is None:
            return
        _, earlier_s, earlier_w, earlier_velocity_w = self._position
        interval_s = boot_s - earlier_s
        if not 0 < interval_s <= _RESET_INTERVAL_S:
            return
        unexplained = [
            b - a - 0.5 * (u + v) * interval_s
            for a, b, u, v in zip(
                earlier_w, position_w, earlier_velocity_w, velocity_w, strict=True
            )
        ]
        if math.hypot(*unexplained) > _RESET_STEP_M:
            self._resets += 1
            self._stepped_s = self._clock.now_s()

    def _take_attitude(self, message: Received) -> None:
        quaternion = (
            message.number("q1"),
            message.number("q2"),
            message.number("q3"),
            message.number("q4"),
        )
        length = math.hypot(*quaternion)
        if not 0.9 < length < 1.1:  # NaN compares false
            return
        self.has_quaternion = True
        self._keep_attitude(message, quaternion)

    def _take_euler_attitude(self, message: Received) -> None:
        """Take the attitude of a vehicle that tells none by quaternion."""
        angles = (message.number("roll"), message.number("pitch"), message.number("yaw"))
        if not self.has_quaternion and all(map(math.isfinite, angles)):
            self._keep_attitude(message, quaternion_from_euler(*angles))

    def _keep_attitude(self, message: Received, quaternion: Quaternion) -> None:
        stamp_s, boot_s = self._boot_stamp(message)
        attitude = swap_attitude(quaternion)
        self._integrate_gyro(message, boot_s, attitude)
        self._attitude = (stamp_s, attitude)

    def _integrate_gyro(self, message: Received, boot_s: float, attitude: Quaternion) -> None:
        """Carry the heading on by the gyro's rate alone; over a gap by the heading itself."""
        rates_b = (0.0, -message.number("pitchspeed"), -message.number("yawspeed"))
        yaw, rate = yaw_of(attitude), _yaw_rate(attitude, rates_b)
        if not math.isfinite(rate):
            self._gyro = None
            return
        if self._gyro is None:
            self._gyro = (boot_s, yaw, yaw, rate)
            return
        before_s, before_yaw, heading, before_rate = self._gyro
        step_s = boot_s - before_s
        turned = 0.5 * (before_rate + rate) * step_s
        if not 0.0 <= step_s <= _GYRO_GAP_S:
            turned = yaw - before_yaw
        self._gyro = (boot_s, yaw, math.remainder(heading + turned, 2 * math.pi), rate)

    def _take_geodetic(self, message: Received) -> None:
        self._geodetic = (
            message.integer("lat") * 1e-7,
            message.integer("lon") * 1e-7,
            message.integer("alt") * 1e-3,
        )

    def _take_landed_state(self, message: Received) -> None:
        self._landed_state = message.integer("landed_state")

    def _take_system_status(self, message: Received) -> None:
        present = message.integer("onboard_control_sensors_present")
        enabled = message.integer("onboard_control_sensors_enabled")
        health = message.integer("onboard_control_sensors_health")
        if present & _PREARM_CHECK:
            self._healthy = bool(health & _PREARM_CHECK)
        else:
            self._healthy = (present & enabled & ~health) == 0 and present != 0
        self._rc_link = bool(present & _RC_RECEIVER and health & _RC_RECEIVER)
        remaining = message.integer("battery_remaining", -1)
        if remaining >= 0 and not self._has_battery_status:
            self._battery = (remaining / 100.0, self._arrival_s(message))

    def _take_battery(self, message: Received) -> None:
        remaining = message.integer("battery_remaining", -1)
        if message.integer("id") == 0 and remaining >= 0:
            self._has_battery_status = True
            self._battery = (remaining / 100.0, self._arrival_s(message))

    def _take_wind(self, message: Received) -> None:
        north, east, down = (message.number(f"wind_{axis}") for axis in "xyz")
        if math.isfinite(north) and math.isfinite(east):
            self._wind = swap_enu_ned((north, east, down if math.isfinite(down) else 0.0))

    def _take_home(self, message: Received) -> None:
        home = (message.number("x"), message.number("y"), message.number("z"))
        if all(map(math.isfinite, home)):
            self._home = swap_enu_ned(home)
            self._home_altitude_m = message.integer("altitude") * 1e-3

    def _take_gps(self, message: Received) -> None:
        accuracy_mm = message.integer("h_acc")
        dilution = message.integer("eph", 65535)
        eph_m: float | None = None
        if accuracy_mm > 0:
            eph_m = accuracy_mm * 1e-3
        elif dilution != 65535:
            eph_m = dilution * 1e-2
        satellites = message.integer("satellites_visible", 255)
        self._gps = (message.integer("fix_type"), eph_m, None if satellites == 255 else satellites)

    def _take_odometry(self, message: Received) -> None:
        count = message.integer("reset_counter")
        changed = self._odometry_reset is not None and count != self._odometry_reset
        # A reset that was seen as a step already is not counted twice.
        if changed and self._clock.now_s() - self._stepped_s > _SAME_RESET_S:
            self._resets += 1
        self._odometry_reset = count

    def _take_text(self, message: Received) -> None:
        self._texts.take(
            self._arrival_s(message),
            message.integer("severity"),
            message.text("text"),
            (message.integer("id"), message.integer("chunk_seq")),
        )


def _yaw_rate(attitude: Quaternion, rates_b: Vec3) -> float:
    """Return how fast the heading changes (rad/s), of body rates FLU; NaN where they are not told.

    ``attitude``: FLU to ENU.
    """
    w, x, y, z = attitude
    right, up = 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    level = right * right + up * up
    if level < 1e-6:
        return math.nan
    return (rates_b[1] * right + rates_b[2] * up) / level
