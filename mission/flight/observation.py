"""What the machine knows at a tick. Plain tuples and numbers, so that it is recorded and replayed.

Positions are local ENU (the autopilot's local frame turned to ENU), metres; angles radians
unless a name says degrees; times are mission seconds. Every part carries its own stamp: its age
is ``observation.now_s - part.stamp_s``. A part that was never received is None.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from mission.flight.earlier import Earlier

Vec3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class FlightMode(StrEnum):
    """Modes that matter here; anything else is the pilot's."""

    OFFBOARD = "offboard"
    HOLD = "hold"
    TAKEOFF = "takeoff"
    LAND = "land"
    RETURN = "return"
    PILOT = "pilot"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The vehicle as the autopilot reports it."""

    stamp_s: float
    """Of the newest position."""
    position_w: Vec3
    velocity_w: Vec3
    quaternion_wb: Quaternion
    """w x y z, rotates body FLU into the world."""
    yaw_rad: float
    """ENU: 0 looks east, pi/2 north."""
    mode: FlightMode
    mode_stamp_s: float
    armed: bool
    in_air: bool
    landed: bool
    heartbeat_stamp_s: float
    battery: float | None = None
    """Charge left, 0-1; None: no telemetry."""
    battery_stamp_s: float = float("-inf")
    wind_w: Vec3 | None = None
    home_w: Vec3 | None = None
    healthy: bool = True
    """The autopilot says that it may be armed."""
    reset_count: int = 0
    """Counts jumps of the autopilot's local frame (estimator resets)."""
    intended: FlightMode | None = None
    """What somebody last asked for, where the autopilot tells it: in a failsafe not the mode."""
    gyro_yaw_rad: float | None = None
    """The heading as the gyro alone has carried it on since the start; None: not told."""
    gps_fix: int | None = None
    """GPS_FIX_TYPE: 3 is 3D, 6 is RTK fixed; None: not told."""
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    altitude_m: float | None = None


@dataclass(frozen=True, slots=True)
class GimbalState:
    """Where the gimbal really looks."""

    stamp_s: float
    yaw_rad: float
    """ENU, absolute."""
    pitch_rad: float
    """Positive up."""
    in_control: bool = True


@dataclass(frozen=True, slots=True)
class CameraState:
    """Exposure as applied, and the photos that exist."""

    stamp_s: float
    ev: float | None
    """Applied EV; None where the camera has no EV control."""
    ev_stamp_s: float
    min_ev: float = -3.0
    max_ev: float = 3.0
    step_ev: float = 1 / 3
    evs: tuple[float, ...] = ()
    """All EVs that it has, ascending, where it lists them; else multiples of the step."""
    manual: bool = True
    """EV is absolute; otherwise it biases the camera's own automatic."""
    shutter_s: float | None = None
    photos_taken: int = 0
    """Count of CAMERA_IMAGE_CAPTURED received."""
    last_photo_id: int = -1
    """`photo id` (ours) of the newest confirmed photo."""
    failed_photo_id: int = -1
    """`photo id` of the newest photo that was given up."""
    online: bool = True


@dataclass(frozen=True, slots=True)
class ClearanceState:
    """Nearest surface seen; the thinned points themselves go to the guard as `Surroundings`."""

    stamp_s: float
    """Of the scan it was computed from."""
    sequence: int
    nearest_m: float | None
    """From the body's centre; None: nothing in range."""
    nearest_w: Vec3 | None
    scan_rate_hz: float = 10.0
    repeated: bool = False
    """The sensor delivers the same scan again and again."""


@dataclass(frozen=True, slots=True)
class HubPrior:
    """Tower and prior hub as found in the ascent (p_h^0)."""

    stamp_s: float
    tower_w: Vec3
    """A point of the tower's axis at the height of the lowest seen ring."""
    tower_axis_w: Vec3
    """Unit, upward."""
    tower_top_m: float | None
    """Height (z) of the tower's top, once seen."""
    hub_w: Vec3 | None
    normal_w: Vec3 | None
    """Unit, downwind; None: side unknown."""
    sigma_m: float
    turning: bool | None = None
    """The rotor was seen to turn; None: not known yet."""


@dataclass(frozen=True, slots=True)
class BladeEstimate:
    """One blade of `RotorEstimate`."""

    name: str
    direction_w: Vec3
    pitch_deg: float | None
    length_m: float | None = None


@dataclass(frozen=True, slots=True)
class RotorEstimate:
    """One rotor estimate, or a refusal."""

    stamp_s: float
    sequence: int
    refusal: str | None = None
    """Code of `perception.rotor.RefusalCode`."""
    refusal_text: str = ""
    hub_w: Vec3 = (0.0, 0.0, 0.0)
    normal_w: Vec3 = (0.0, 1.0, 0.0)
    stop_angle_deg: float = 0.0
    sigma_deg: float = 0.0
    reference: str = "gravity"
    blades: tuple[BladeEstimate, ...] = ()
    cone_deg: float = 0.0
    method: str = ""


@dataclass(frozen=True, slots=True)
class TurbineSeen:
    """How far the whole turbine stands from where it was measured, in the frame of the position."""

    stamp_s: float
    """Of the newest of the scans that show it."""
    offset_w: Vec3
    """At the vehicle."""
    heading_rad: float
    """By how much it appears turned about the vehicle, counter-clockwise from above."""
    covariance: tuple[float, ...]
    """Upper triangle, row by row, of offset and heading: large where that was not seen."""


@dataclass(frozen=True, slots=True)
class BladeTrack:
    """The blade that is flown along, as seen by the last scans (Eq. 3)."""

    stamp_s: float
    blade: str
    foot_w: Vec3
    """Perpendicular foot of the vehicle on the blade's line."""
    direction_w: Vec3
    """Unit, root to tip."""
    distance_m: float
    """From the vehicle to the foot."""
    points_per_s: float
    offset_w: Vec3
    """Measured axis minus modelled axis at the foot, perpendicular to the axis."""
    residual_m: float
    tip_m: float | None = None
    """Metre (from the root flange) of the tip, when it is in view."""
    from_model: bool = False
    """The edge returns too little: the fitted rotor holds the distance."""
    turbine: TurbineSeen | None = None
    """The newest sighting of the whole turbine."""


@dataclass(frozen=True, slots=True)
class ExposureState:
    """Metering of the newest usable frame, and the EV that the controller asks for."""

    stamp_s: float
    """Of the frame."""
    mean_grey: float
    in_range: bool
    ev_wanted: float
    clipped: float = 0.0
    """Share of metered pixels that are saturated."""
    pixels: int = 0
    at_limit: bool = False
    """The camera has no EV that would bring the blade into range."""


@dataclass(frozen=True, slots=True)
class PhotoResult:
    """A photo that was fetched and judged."""

    photo_id: int
    kept: bool
    reason: str = ""
    stamp_s: float | None = None
    """When its shutter opened."""
    mean_grey: float | None = None
    """Of the blade in it."""
    exposed: bool = True
    """False: the blade in it is out of the range of exposure; it is the best there is."""
    beside_w: Vec3 | None = None
    """From the optical axis to the blade's middle; None: its outline was not found."""


class RequestKind(StrEnum):
    """What an operator may ask for."""

    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    SKIP = "skip"
    STOP = "stop"
    ABORT = "abort"


@dataclass(frozen=True, slots=True)
class Request:
    """One validated intent; given to the machine in exactly one observation."""

    kind: RequestKind
    request_id: str
    site: str = ""
    operator: str = ""
    rotor_locked: bool = False
    """The operator's word: rotor braked and locked, yaw off."""
    blades: tuple[str, ...] = ("A", "B", "C")
    sides: tuple[str, ...] = ("PS", "SS", "LE", "TE")
    flight: int = 1
    """Number of the flight of an inspection; a later one waits for `Observation.earlier`."""
    airborne: bool = False
    """Take over the vehicle where it hovers."""
    rendezvous_w: Vec3 | None = None
    """Where it is handed back; None: where it was taken over."""


@dataclass(frozen=True, slots=True)
class PreflightItem:
    """One check of the preflight list, gathered by the shell."""

    name: str
    passed: bool
    text: str
    mend: str = ""


@dataclass(frozen=True, slots=True)
class Silence:
    """A gap in our own stream of setpoints, as our own clock knows it."""

    from_s: float
    """When the last setpoint left."""
    read_after_s: float
    """A mode reported from then on is what the autopilot has made of the gap."""
    closed: bool = False
    """Setpoints leave again; the gap was a moment ago, and reports of the mode come late."""


@dataclass(frozen=True, slots=True)
class Observation:
    """Newest of everything at a tick."""

    now_s: float
    tick: int
    vehicle: Vehicle | None = None
    gimbal: GimbalState | None = None
    camera: CameraState | None = None
    clearance: ClearanceState | None = None
    hub_prior: HubPrior | None = None
    rotor: RotorEstimate | None = None
    blade: BladeTrack | None = None
    exposure: ExposureState | None = None
    photos: tuple[PhotoResult, ...] = ()
    """Judged since the last tick."""
    requests: tuple[Request, ...] = ()
    """Received since the last tick."""
    preflight: tuple[PreflightItem, ...] = ()
    offboard_refused: str | None = None
    """Text of the last refused arm, take-off or offboard command."""
    sensing_alive: bool = True
    late_s: float = 0.0
    """How late this tick began."""
    silent: Silence | None = None
    notes: tuple[str, ...] = field(default=())
    earlier: Earlier | None = None
    """What earlier flights left behind: told once, before the take-off of a later one."""
    guard_refused: str = ""
    """Why the guard replaced the setpoint of the tick before; empty: it did not."""
