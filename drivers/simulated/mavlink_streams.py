"""The autopilot's telemetry: each message from one snapshot, each at its own rate.

Rates are per second of mission time and times in messages are mission time, so that a world that
runs faster looks like a vehicle that lives faster. NED here, as on the wire.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.simulated.mavlink_wire import Message, made
from drivers.simulated.ned import Home, euler, ned_quaternion, swapped
from drivers.simulated.vehicle import Quaternion, Vec3

_NAN = math.nan
_UNKNOWN_U16 = 65535
_MOTORS, _RC, _PREARM, _BATTERY = 0x8000, 0x10000, 0x10000000, 0x2000000
_ALWAYS = 0x1 | 0x2 | 0x4 | 0x8 | 0x1000 | _MOTORS | _RC | 0x200000
_GPS = 0x20


@dataclass(slots=True)
class Telemetry:
    """What the autopilot knows at a tick. Local ENU and FLU, as estimated."""

    home: Home
    now_s: float = 0.0
    position_l: Vec3 = (0.0, 0.0, 0.0)
    velocity_l: Vec3 = (0.0, 0.0, 0.0)
    quaternion_lb: Quaternion = (1.0, 0.0, 0.0, 0.0)
    rates_b: Vec3 = (0.0, 0.0, 0.0)
    wind_l: Vec3 = (0.0, 0.0, 0.0)
    custom_mode: int = 0
    intended_custom_mode: int = 0
    armed: bool = False
    failsafe: bool = False
    landed_state: int = 1
    armable: bool = False
    position_ok: bool = True
    position_sigma_m: float = 0.1
    charge: float = 1.0
    pack_v: float = 25.0
    cells: int = 6
    current_a: float = 0.0
    used_wh: float = 0.0
    battery_present: bool = True
    thrust_share: float = 0.0
    reset_count: int = 0
    ned_q: Quaternion = field(default=(1.0, 0.0, 0.0, 0.0))
    """FRD in NED, kept beside `quaternion_lb` by `settle`."""

    def settle(self) -> None:
        """Compute what several messages share."""
        self.ned_q = ned_quaternion(self.quaternion_lb)

    @property
    def ms(self) -> int:
        """Mission time in milliseconds, as time_boot_ms."""
        return int(self.now_s * 1e3) & 0xFFFFFFFF

    @property
    def us(self) -> int:
        """Mission time in microseconds."""
        return int(self.now_s * 1e6)


def _heartbeat(t: Telemetry) -> Message:
    base = 0x01 | 0x10 | 0x40 | (0x80 if t.armed else 0)
    status = 5 if t.failsafe else (4 if t.armed else 3)
    return made("heartbeat", 2, 12, base, t.custom_mode, status, 3)


def _sys_status(t: Telemetry) -> Message:
    present = _ALWAYS | _GPS | _BATTERY | _PREARM
    health = _ALWAYS
    health |= _GPS if t.position_ok else 0
    health |= _BATTERY if t.battery_present else 0
    health |= _PREARM if t.armable else 0
    volts = int(t.pack_v * 1e3) if t.battery_present else _UNKNOWN_U16
    amps = int(t.current_a * 100) if t.battery_present else -1
    left = math.ceil(t.charge * 100) if t.battery_present else -1
    return made("sys_status", present, present, health, 300, volts, amps, left, 0, 0, 0, 0, 0, 0)


def _battery_status(t: Telemetry) -> Message | None:
    if not t.battery_present:
        return None
    cell = int(t.pack_v / t.cells * 1e3)
    voltages = [cell if i < t.cells else _UNKNOWN_U16 for i in range(10)]
    used_mah = int(t.used_wh / (t.cells * 3.7) * 1e3)
    return made(
        "battery_status",
        0,
        0,
        1,
        3000,
        voltages,
        int(t.current_a * 100),
        used_mah,
        int(t.used_wh * 36),
        math.ceil(t.charge * 100),
        0,
        1,
    )


def _extended_sys_state(t: Telemetry) -> Message:
    return made("extended_sys_state", 0, t.landed_state)


def _attitude_quaternion(t: Telemetry) -> Message:
    p, q, r = t.rates_b
    return made("attitude_quaternion", t.ms, *t.ned_q, p, -q, -r)


def _attitude(t: Telemetry) -> Message:
    p, q, r = t.rates_b
    return made("attitude", t.ms, *euler(t.ned_q), p, -q, -r)


def _local_position_ned(t: Telemetry) -> Message:
    return made("local_position_ned", t.ms, *swapped(t.position_l), *swapped(t.velocity_l))


def _odometry(t: Telemetry) -> Message:
    p, q, r = t.rates_b
    vx, vy, vz = swapped(t.velocity_l)
    unknown = [_NAN] * 21
    return made(
        "odometry",
        t.us,
        1,
        1,
        *swapped(t.position_l),
        list(t.ned_q),
        vx,
        vy,
        vz,
        p,
        -q,
        -r,
        unknown,
        unknown,
        t.reset_count % 256,
        8,
        100,
    )


def _heading_cdeg(t: Telemetry) -> int:
    return int(math.degrees(euler(t.ned_q)[2]) * 100) % 36000


def _global_position_int(t: Telemetry) -> Message | None:
    if not t.position_ok:
        return None
    latitude, longitude, altitude = t.home.geodetic(t.position_l)
    vn, ve, vd = swapped(t.velocity_l)
    return made(
        "global_position_int",
        t.ms,
        round(latitude * 1e7),
        round(longitude * 1e7),
        round(altitude * 1e3),
        round(t.position_l[2] * 1e3),
        int(vn * 100),
        int(ve * 100),
        int(vd * 100),
        _heading_cdeg(t),
    )


def _gps_raw_int(t: Telemetry) -> Message:
    latitude, longitude, altitude = t.home.geodetic(t.position_l)
    fix = (6 if t.position_sigma_m < 0.5 else 3) if t.position_ok else 0
    vn, ve, _ = swapped(t.velocity_l)
    course = int(math.degrees(math.atan2(ve, vn)) * 100) % 36000
    return made(
        "gps_raw_int",
        t.us,
        fix,
        round(latitude * 1e7),
        round(longitude * 1e7),
        round(altitude * 1e3),
        70 if t.position_ok else _UNKNOWN_U16,
        90 if t.position_ok else _UNKNOWN_U16,
        int(math.hypot(vn, ve) * 100),
        course,
        18 if t.position_ok else 0,
    )


def _home_position(t: Telemetry) -> Message:
    home = t.home
    return made(
        "home_position",
        round(home.latitude_deg * 1e7),
        round(home.longitude_deg * 1e7),
        round(home.altitude_m * 1e3),
        0.0,
        0.0,
        0.0,
        [1.0, 0.0, 0.0, 0.0],
        0.0,
        0.0,
        0.0,
        t.us,
    )


def _wind_cov(t: Telemetry) -> Message:
    return made(
        "wind_cov",
        t.us,
        *swapped(t.wind_l),
        0.5,
        0.5,
        t.home.altitude_m + t.position_l[2],
        0.5,
        0.5,
    )


def _vfr_hud(t: Telemetry) -> Message:
    east, north, up = t.velocity_l
    air = math.hypot(east - t.wind_l[0], north - t.wind_l[1])
    return made(
        "vfr_hud",
        air,
        math.hypot(east, north),
        _heading_cdeg(t) // 100,
        int(min(t.thrust_share, 1.0) * 100),
        t.home.altitude_m + t.position_l[2],
        up,
    )


def _altitude(t: Telemetry) -> Message:
    height = t.position_l[2]
    amsl = t.home.altitude_m + height
    return made("altitude", t.us, amsl, amsl, height, height, _NAN, _NAN)


def _current_mode(t: Telemetry) -> Message:
    return made("current_mode", 0, t.custom_mode, t.intended_custom_mode)


def _estimator_status(t: Telemetry) -> Message:
    flags = 0x1 | 0x2 | 0x4 | 0x20 | (0x8 | 0x10 if t.position_ok else 0x80)
    sigma = t.position_sigma_m if t.position_ok else 50.0
    return made("estimator_status", t.us, flags, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, sigma, sigma)


def _autopilot_version(_: Telemetry) -> Message:
    # Bytewise parameters, COMMAND_INT, local set-points, MAVLink 2, fence and mission items.
    capabilities = 0x2 | 0x4 | 0x8 | 0x80 | 0x2000 | 0x4000 | 0x20000
    version = 1 << 24 | 17 << 16 | 0 << 8 | 255
    nothing = [0] * 8
    return made(
        "autopilot_version", capabilities, version, 0, 0, 0, nothing, nothing, nothing, 0, 0, 1
    )


Builder = Callable[[Telemetry], Message | None]

BUILDERS: dict[int, Builder] = {
    0: _heartbeat,
    1: _sys_status,
    24: _gps_raw_int,
    30: _attitude,
    31: _attitude_quaternion,
    32: _local_position_ned,
    33: _global_position_int,
    74: _vfr_hud,
    141: _altitude,
    147: _battery_status,
    148: _autopilot_version,
    230: _estimator_status,
    231: _wind_cov,
    242: _home_position,
    245: _extended_sys_state,
    331: _odometry,
    436: _current_mode,
}
"""Message number -> how it is made."""

DEFAULT_HZ: dict[int, float] = {
    0: 1.0,
    1: 1.0,
    24: 2.0,
    30: 10.0,
    31: 50.0,
    32: 50.0,
    33: 10.0,
    74: 2.0,
    147: 1.0,
    230: 1.0,
    231: 1.0,
    242: 0.5,
    245: 1.0,
}
"""What streams unasked."""

MAX_HZ = 50.0
"""One message a tick."""


class Streams:
    """Which message is due when."""

    def __init__(self) -> None:
        self._period_s = {number: 1 / hz for number, hz in DEFAULT_HZ.items()}
        # Spread, so that the 1 Hz messages do not come in one burst.
        self._next_s = {n: 0.02 * i for i, n in enumerate(self._period_s)}

    def due(self, telemetry: Telemetry) -> list[Message]:
        """Return the messages to send now."""
        now_s = telemetry.now_s
        messages: list[Message] = []
        for number, next_s in self._next_s.items():
            if next_s > now_s + 1e-6:
                continue
            period_s = self._period_s[number]
            self._next_s[number] = max(next_s + period_s, now_s)
            message = BUILDERS[number](telemetry)
            if message is not None:
                messages.append(message)
        return messages

    def bring_forward(self, number: int) -> None:
        """Send a message at the next tick, whatever its rate."""
        if number in self._next_s:
            self._next_s[number] = -math.inf

    def interval_us(self, number: int) -> int:
        """Return the interval as MESSAGE_INTERVAL tells it: -1 off, 0 unknown."""
        if number not in BUILDERS:
            return 0
        return round(self._period_s[number] * 1e6) if number in self._period_s else -1

    def set_interval(self, number: int, interval_us: float, now_s: float) -> bool:
        """Honour SET_MESSAGE_INTERVAL: -1 stops, 0 takes the default. False where unknown."""
        if number not in BUILDERS or not math.isfinite(interval_us):
            return False
        hz = DEFAULT_HZ.get(number, 0.0) if interval_us == 0 else 0.0
        hz = 1e6 / interval_us if interval_us > 0 else hz
        self._period_s.pop(number, None)
        self._next_s.pop(number, None)
        if hz > 0:
            self._period_s[number] = 1 / min(hz, MAX_HZ)
            self._next_s[number] = now_s
        return True
