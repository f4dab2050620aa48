"""What processes tell each other on the bus, and what they are asked: versioned JSON."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from config.inspection import BladeName, Side
from mission.flight.command import Command, PhotoCommand, Progress
from mission.flight.earlier import Earlier
from mission.flight.observation import (
    BladeTrack,
    CameraState,
    ClearanceState,
    ExposureState,
    GimbalState,
    HubPrior,
    Observation,
    RequestKind,
    RotorEstimate,
    Vec3,
    Vehicle,
)
from mission.flight.report import MissionReport

SCHEMA = 1
Identifier = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")]


class Message(BaseModel):
    """Base: frozen, strict about names, finite numbers only."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


Compass = Annotated[float, Field(ge=0, lt=360)]
Pitch = Annotated[float, Field(ge=-10, le=100)]
Serial = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[^\x00-\x1f]+$")]
Serials = dict[BladeName, Serial]


class Known(Message):
    """What the operator knows of the turbine today; None: what the configuration says."""

    nacelle_yaw_deg: Compass | None = None
    """Compass direction into which the rotor faces (upwind)."""
    blade_pitch_deg: Pitch | None = None
    """0 = operating, 90 = feathered."""
    blade_serials: Serials = Field(default_factory=dict)
    """Which physical blade stands in which position."""
    launch_enu_m: Vec3 | None = None
    """Where the vehicle takes off, east, north and up of the tower's base."""


class StartRequest(Known):
    """Start a mission at one turbine."""

    version: Literal[1] = 1
    id: Identifier
    """Idempotency key: the same id never starts a second mission."""
    site: Identifier
    operator: Annotated[str, Field(min_length=1, max_length=80)]
    rotor_locked: bool
    """The operator's word: rotor braked and locked, yaw off."""
    blades: tuple[BladeName, ...] | None = None
    sides: tuple[Side, ...] | None = None
    airborne: bool = False
    """The vehicle hovers: take it over there, and hand it back hovering."""
    rendezvous_w: Vec3 | None = None
    """Where it is handed back: east, north, up of its home; None: where it was taken over."""
    expires_utc_s: float | None = None
    """A request that arrives later starts nothing."""
    dry_run: bool = False
    """Check the request and say what would be flown; start nothing."""


class ResumeRequest(Message):
    """Go on: after a pause; or, where no mission runs, with one that ended unfinished."""

    version: Literal[1] = 1
    id: Identifier
    airborne: bool = False
    """The vehicle hovers: take it over there."""
    mission: Annotated[str, Field(max_length=120, pattern=r"^([A-Za-z0-9][A-Za-z0-9_.-]*)?$")] = ""
    """Name of the mission folder; empty: what is under way, else the newest."""
    operator: Annotated[str, Field(max_length=80)] = ""
    rotor_locked: bool = False
    """The operator's word: rotor braked and locked since, yaw off."""
    dry_run: bool = False
    """Check the request and say what would be done; start nothing."""


class PlainRequest(Message):
    """Pause, resume, skip, stop, abort, status, turbines, history."""

    version: Literal[1] = 1
    id: Identifier


class Code(StrEnum):
    """What a reply says to a program; these words do not change."""

    OK = "ok"
    STARTING = "starting"
    STARTED = "started"
    ALREADY_STARTED = "already_started"
    WOULD_START = "would_start"
    RESUMED = "resumed"
    NOT_RESUMABLE = "not_resumable"
    ACCEPTED = "accepted"
    BAD_REQUEST = "bad_request"
    TOO_LARGE = "too_large"
    TOO_MANY_REQUESTS = "too_many_requests"
    NOT_ALLOWED = "not_allowed"
    EXPIRED = "expired"
    ID_REUSED = "id_reused"
    UNKNOWN_TURBINE = "unknown_turbine"
    NOT_CONFIRMED = "not_confirmed"
    NOT_READY = "not_ready"
    NO_VEHICLE = "no_vehicle"
    BUSY = "busy"
    NOT_RUNNING = "not_running"
    NO_FOLDER = "no_folder"


class TurbineInfo(Message):
    """One turbine that a mission may be started for."""

    name: str
    turbine: str
    """Its type."""
    hub_height_m: float
    rotor_diameter_m: float
    blade_length_m: float
    tower_enu_m: Vec3
    """Foot of the tower from the take-off point, as configured."""


class PhotoShown(Message):
    """Where on the turbine one photo was taken, and whether it was kept."""

    photo_id: int
    blade: str
    side: str
    metre: float
    distance_m: float
    half_m: float
    """Half the length of the blade that the picture spans."""
    kept: bool | None = None
    """None: not judged yet."""


class Reply(Message):
    """The answer to any request. `code` is stable; `text` is for people."""

    version: Literal[1] = 1
    ok: bool
    code: str
    text: str
    mission_dir: str = ""
    state: StateMessage | None = None
    turbines: tuple[TurbineInfo, ...] = ()
    events: tuple[EventMessage, ...] = ()
    """On `history`: the newest events, oldest first."""
    photos: tuple[PhotoShown, ...] = ()
    """On `history`: the photos of the mission, oldest first."""
    rotor: RotorEstimate | None = None
    """On `history`: the newest estimate of this mission."""


class Intent(Known):
    """Supervisor to flight: one validated intent."""

    kind: RequestKind
    id: str
    site: str = ""
    operator: str = ""
    rotor_locked: bool = False
    blades: tuple[BladeName, ...] = ("A", "B", "C")
    sides: tuple[Side, ...] = ("PS", "SS", "LE", "TE")
    mission_dir: str = ""
    flight: int = 1
    """Number of the flight of this inspection."""
    airborne: bool = False
    rendezvous_w: Vec3 | None = None


class EarlierMessage(Message):
    """Recorder to flight, before a later flight: what the earlier ones left behind."""

    mission_dir: str
    flight: int
    """For which flight it is told."""
    earlier: Earlier


class VehicleMessage(Message):
    """Flight to everyone, 20 times a second: vehicle, gimbal and camera as reported."""

    vehicle: Vehicle | None = None
    gimbal: GimbalState | None = None
    camera: CameraState | None = None

    # A battery that never reported has a stamp of minus infinity; JSON has no such number.
    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=True, ser_json_inf_nan="strings"
    )


class StateMessage(Message):
    """Flight to everyone, 5 times a second, at rest twice: what an operator is shown."""

    version: Literal[1] = 1
    vehicle: str
    mission_dir: str
    site: str
    mission_s: float
    factor: float
    progress: Progress
    position_w: Vec3 | None = None
    height_m: float | None = None
    """Above take-off: the autopilot's own origin may lie elsewhere."""
    battery: float | None = None
    lidar_age_s: float | None = None
    ev: float | None = None
    grey: float | None = None
    link_ok: bool = True
    yaw_rad: float | None = None
    """ENU: 0 looks east."""
    loop_lag_ms: float | None = None
    """How late the latest tick of the last second came."""
    setpoint_gap_ms: float | None = None
    """Longest gap between setpoints in the last second, mission time."""
    resting: bool = False
    """Disarmed and no mission under way: everything may go slowly until the next start."""


class EventMessage(Message):
    """Something happened: to the operator, the journal and the report."""

    mission_s: float
    name: str
    severity: str
    text: str
    cleared: bool = False


class PhotoTakenMessage(Message):
    """Flight to recorder: a photo exists at the camera."""

    command: PhotoCommand
    url: str
    index: int
    stamp_s: float
    utc: str
    position_w: Vec3
    height_m: float | None = None
    """Above take-off."""
    quaternion_wb: tuple[float, float, float, float]
    gimbal_yaw_rad: float
    gimbal_pitch_rad: float
    foot_w: Vec3 | None = None
    distance_m: float | None = None
    gsd_mm: float | None = None
    ev: float | None = None
    shutter_s: float | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    altitude_m: float | None = None


class MeteringMessage(Message):
    """Tracking to whoever watches: where in the live picture the exposure was metered.

    All lengths are shares of the picture's width, from its upper left corner.
    """

    stamp_s: float
    aspect: float
    """Height of the picture."""
    centre: tuple[float, float]
    radius: float
    outline: tuple[tuple[float, float], ...] = ()
    """Of the blade: of the disc, only what lies within it was metered. Empty: all of it."""


class PhotoResultMessage(Message):
    """Recorder to flight: the photo was fetched and judged."""

    photo_id: int
    kept: bool
    reason: str = ""
    stamp_s: float | None = None
    mean_grey: float | None = None
    """Of the blade in it, where it was found."""
    exposed: bool = True
    """False: the blade in it is known to be out of the range of exposure."""
    beside_w: Vec3 | None = None
    """From the optical axis to the blade's middle, metres, where its outline was found."""


class FlightReport(Message):
    """Flight to recorder, once at the end: the flight's part of mission.json."""

    report: MissionReport
    site: str
    turbine: str
    operator: str
    rotor_locked: bool
    started_utc: str
    place: tuple[float, float, Vec3] | None = None
    """Latitude and longitude, degrees, of a place of the flight's own frame."""
    tower_foot_w: Vec3
    """Where the tower's axis meets the ground, in the frame of the flight: origin of `hub_m`."""
    frames: int = 0
    frames_out_of_range: int = 0
    real_time_factor: float | None = None
    tick_gap_ms: dict[str, float] = Field(default_factory=dict)


class RecordedMessage(Message):
    """Recorder to everyone: the mission folder is complete."""

    mission_dir: str
    ok: bool
    text: str = ""


class SensingHealth(Message):
    """Sensing to flight and supervisor, once a second and at each change."""

    mission_s: float
    lidar_online: bool
    camera_online: bool
    scans: int
    frames: int
    dropped: int = 0
    """Messages that did not fit on the bus."""


class ReadyMessage(Message):
    """A perception worker or the recorder, once a second: it can work."""

    name: str
    recording: str = ""
    """The folder of the mission that the recorder records."""


class TakenMessage(Message):
    """A perception worker to the recorder: it takes up a scan or a frame, and knows this much.

    With it a replay computes the same again: which were taken up, and with which poses.
    """

    worker: Literal["tracking", "estimation"]
    what: Literal["scan", "frame"]
    stamp_s: float
    """Of the scan or the frame."""
    pose_s: float | None
    """Of the newest pose known; None: none yet."""
    task_id: int


class TickRecord(BaseModel):
    """One tick as recorded: what was known, what was decided, what was sent."""

    model_config = ConfigDict(frozen=True, ser_json_inf_nan="strings")
    observation: Observation
    command: Command
    """As the guard let it pass."""
    refused: str = ""
    """Why the guard changed it; empty: unchanged."""
    sent: bool | None = None
    """The setpoint left for the autopilot; None: recorded before that was told."""
    surroundings_s: float | None = None
    """Stamp of the occupancy that the guard looked at: minus infinity before the first."""


Reply.model_rebuild()

__all__ = [
    "BladeTrack",
    "ClearanceState",
    "Code",
    "EventMessage",
    "ExposureState",
    "FlightReport",
    "HubPrior",
    "Intent",
    "Known",
    "MeteringMessage",
    "PhotoResultMessage",
    "PhotoShown",
    "PhotoTakenMessage",
    "PlainRequest",
    "ReadyMessage",
    "RecordedMessage",
    "Reply",
    "RotorEstimate",
    "SensingHealth",
    "StartRequest",
    "StateMessage",
    "TakenMessage",
    "TickRecord",
    "TurbineInfo",
    "VehicleMessage",
]
