"""What the machine wants done at a tick, and the sensing task it sets. Plain, recordable values."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from mission.flight.observation import BladeEstimate, Vec3


class Phase(StrEnum):
    """Where the mission is."""

    IDLE = "idle"
    PREFLIGHT = "preflight"
    TAKEOFF = "takeoff"
    ASCEND = "ascend"
    APPROACH = "approach"
    ESTIMATE = "estimate"
    TRACK = "track"
    RETURN = "return"
    LANDED = "landed"
    HOLD = "hold"
    STAND_OFF = "stand_off"
    RELEASED = "released"


class MissionState(StrEnum):
    """How the mission stands, or ended."""

    IDLE = "idle"
    RUNNING = "running"
    PAUSED = "paused"
    COMPLETED = "completed"
    ENDED_SAFELY = "ended_safely"
    REFUSED = "refused"
    FAILED = "failed"
    RELEASED = "released"


#: A mission in one of these states is over.
TERMINAL = frozenset(
    {
        MissionState.COMPLETED,
        MissionState.ENDED_SAFELY,
        MissionState.REFUSED,
        MissionState.FAILED,
        MissionState.RELEASED,
    }
)


class Action(StrEnum):
    """A mode or arming command to the autopilot, acknowledged and retried by the shell."""

    ARM = "arm"
    DISARM = "disarm"
    TAKEOFF = "takeoff"
    OFFBOARD = "offboard"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Position with the velocity fed forward, local ENU, and the yaw (ENU, radians)."""

    position_w: Vec3
    velocity_w: Vec3
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class GimbalAim:
    """Where the optical axis shall point: ENU yaw and pitch (positive up), radians."""

    yaw_rad: float
    pitch_rad: float


@dataclass(frozen=True, slots=True)
class PhotoCommand:
    """Take one photo; the id is unique within the mission and comes back in its record."""

    photo_id: int
    blade: str
    side: str
    metre: float
    distance_m: float
    foot_w: Vec3 | None = None
    """The point of the blade's axis that the camera is aimed at."""
    repeated: bool = False
    marks: tuple[str, ...] = ()
    """Why the photo may be doubtful: `exposure`, `limit` of the camera, `aim`, `from_model`."""


class SensingMode(StrEnum):
    """What the perception pipeline shall compute besides clearance."""

    IDLE = "idle"
    TOWER = "tower"
    ROTOR = "rotor"
    BLADE = "blade"


@dataclass(frozen=True, slots=True)
class SensingTask:
    """Set by the machine, carried out by sensing; clearance is always computed."""

    mode: SensingMode
    task_id: int
    """A new id clears what was accumulated (a new scan position, a new blade)."""
    tower_w: Vec3 | None = None
    """Prior tower base."""
    hub_w: Vec3 | None = None
    normal_w: Vec3 | None = None
    turbine: str = ""
    """Name of the site: gives the catalogue's dimensions."""
    blade: str = ""
    side: str = ""
    """PS, SS, LE or TE: which face of the blade is before the vehicle."""
    blade_root_w: Vec3 | None = None
    """Root flange and tip of the modelled axis of the tracked blade."""
    blade_tip_w: Vec3 | None = None
    half_width_m: float = 3.0
    """Points within this distance of the modelled axis belong to the blade."""
    blind: bool = False
    """The LiDAR cannot look at this side: what it finds near the blade is something else."""
    others: tuple[tuple[Vec3, Vec3, float, float], ...] = ()
    """Other solids near the blade, as truncated cones (end, end, radius at each, metres)."""
    blades: tuple[BladeEstimate, ...] = ()
    """Blades whose pitch is known, as measured about the hub: by them the turbine is sighted."""
    measured_s: float | None = None
    """When they were measured."""
    still_offset_grey: float = 0.0
    """How much brighter the camera's stills are than its live picture."""


@dataclass(frozen=True, slots=True)
class Progress:
    """What an operator is shown."""

    phase: Phase
    state: MissionState
    words: str
    """The reason or activity in one sentence."""
    pass_index: int = 0
    """The pass that is flown, or was the last: 1 is the first; 0 before it."""
    pass_count: int = 0
    blade: str = ""
    side: str = ""
    metre: float | None = None
    distance_m: float | None = None
    clearance_m: float | None = None
    stop_angle_deg: float | None = None
    sigma_deg: float | None = None
    photos: int = 0
    coverage: float = 0.0
    """Share of the planned metres photographed so far."""
    flight: int = 1
    """Number of this flight of the inspection."""
    swap: bool = False
    """The energy ended this flight: with a fresh battery `resume` goes on."""


@dataclass(frozen=True, slots=True)
class Command:
    """One tick's decision."""

    tick: int
    setpoint: Setpoint | None
    """None: send none (not in offboard, or released)."""
    action: Action | None
    gimbal: GimbalAim | None
    ev: float | None
    photo: PhotoCommand | None
    sensing: SensingTask
    progress: Progress
    takeoff_height_m: float | None = None
