"""mission.json as it is read again: what the report needs of it, checked.

What an older version did not write is None or empty; what a newer one adds is passed over.
"""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from config.errors import first_fault
from mission.records.course import Course
from mission.records.files import MISSION

Xyz = tuple[float, float, float]


class NotAMission(ValueError):
    """The folder holds no mission that can be read."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")


class PhasePart(_Part):
    """One phase, mission seconds."""

    phase: str
    from_s: float
    to_s: float


class BladePart(_Part):
    """One blade of the measured rotor."""

    name: str
    angle_deg: float
    pitch_deg: float | None


class RotorPart(_Part):
    """The rotor as measured; hub from the tower's foot, east, north, up."""

    stop_angle_deg: float
    sigma_deg: float
    reference: str
    hub_m: Xyz
    normal: Xyz
    blades: tuple[BladePart, ...]
    method: str
    iterations: int


class Spread(_Part):
    """Distance kept to the blade's axis along a pass."""

    mean: float | None = None
    rms_error: float | None = None
    min: float | None = None


class Least(_Part):
    """The least of a figure."""

    min: float | None = None


class UnseenPart(_Part):
    """A stretch of a blade's side that was not planned, and why."""

    from_m: float
    to_m: float
    reason: str


class PassPart(_Part):
    """One side of one blade."""

    blade: str
    side: str
    length_m: float
    planned_m: float
    coverage: float
    coverage_reachable: float
    photographed_m: tuple[tuple[float, float], ...] = ()
    distance_m: Spread
    clearance_m: Least
    gsd_mm: float | None = None
    photos: int
    rejected: int
    unseen: tuple[UnseenPart, ...] = ()
    skipped: bool = False


class PhotoPart(_Part):
    """One photo."""

    file: str
    blade: str
    side: str
    metre: float
    kept: bool
    reason: str
    mean_grey: float | None = None
    in_range: bool | None = None
    ev: float | None = None
    distance_m: float | None = None
    gsd_mm: float | None = None


class PhotoCounts(_Part):
    """Photos by what became of them."""

    kept: int
    rejected: int
    lost: int


class ExposurePart(_Part):
    """Live frames and stills against the wanted range of mean grey."""

    method: str
    range: tuple[float, float]
    frames: int
    frames_out_of_range: int
    stills: int
    stills_out_of_range: int


class Gaps(_Part):
    """Times between setpoints, milliseconds."""

    p50: float | None = None
    p99: float | None = None
    max: float | None = None


class TimingPart(_Part):
    """How well time was kept."""

    real_time_factor: float | None = None
    setpoint_gap_ms: Gaps | None = None
    tick_gap_ms: Gaps | None = None


class TrueVehicle(_Part):
    """The vehicle as the simulated world saw it."""

    collisions: int | None = None
    touchdown_mps: float | None = None
    landing_error_m: float | None = None
    battery_left: float | None = None


class TrueWind(_Part):
    """The wind that blew."""

    mean_mps: float | None = None
    from_deg: float | None = None
    max_mps: float | None = None


class TruthPart(_Part):
    """What the simulated world knows."""

    stop_angle_deg: float | None = None
    hub_m: Xyz | None = None
    pitch_deg: dict[str, float | None] = Field(default_factory=dict)
    min_clearance_m: float | None = None
    coverage: dict[str, dict[str, float | None]] = Field(default_factory=dict)
    coverage_reachable: dict[str, dict[str, float | None]] = Field(default_factory=dict)
    stills_kept: int | None = None
    stills_centred: float | None = None
    """Share of those that show a whole width of blade: its middle within 5 % of the picture's."""
    stills_out_of_range: int | None = None
    stills_blurred: int | None = None
    vehicle: TrueVehicle = TrueVehicle()
    wind: TrueWind = TrueWind()


class MetreErrors(_Part):
    """Of the photos' stated metres."""

    p95_m: float


class ErrorsPart(_Part):
    """Measured less true."""

    stop_angle_deg: float | None = None
    hub_m: float | None = None
    normal_deg: float | None = None
    pitch_deg: dict[str, float] = Field(default_factory=dict)
    photo_metres: MetreErrors | None = None


class FaultPart(_Part):
    """A warning or worse, mission seconds."""

    mission_s: float
    event: str
    text: str


class InspectionPart(_Part):
    """Who inspected with what, as the settings told it."""

    title: str = "Blade inspection"
    company: str = ""
    customer: str = ""
    pilot: str = ""
    drone: str = ""
    camera: str = ""
    picture: str = ""
    lens: str = ""
    time_zone: str = "UTC"
    weather: str = ""
    weather_source: str = ""
    remarks: str = ""
    closing: str = ""
    blade_serials: dict[str, str] = Field(default_factory=dict)
    wanted_distance_m: float | None = None
    min_clearance_m: float | None = None
    max_gsd_mm: float | None = None
    blades: tuple[str, ...] = ()
    sides: tuple[str, ...] = ()


class ShapePart(_Part):
    """The blade's outline by its length, as the catalogue has it."""

    span: tuple[float, ...]
    chord_m: tuple[float, ...]
    thickness: tuple[float, ...]
    pitch_axis: tuple[float, ...]


class FlightPart(_Part):
    """One flight of the inspection."""

    number: int
    operator: str = ""
    started_utc: datetime | None = None
    duration_s: float = 0.0
    state: str = ""
    words: str = ""
    swap: bool = False
    """The energy ended it."""


class MissionFile(_Part):
    """The whole of mission.json, as far as it is shown."""

    schema_version: Literal[1] = Field(alias="schema")
    version: str
    state: str
    words: str
    simulated: bool
    vehicle: str
    site: str
    turbine: str
    operator: str
    rotor_locked: bool
    started_utc: datetime
    ended_utc: datetime
    duration_s: float
    phases: tuple[PhasePart, ...]
    method: str
    rotor: RotorPart | None
    passes: tuple[PassPart, ...]
    coverage: float
    clearance_m: Least
    gsd_mm: float | None
    photos: PhotoCounts
    photo_list: tuple[PhotoPart, ...]
    exposure: ExposurePart
    timing: TimingPart
    faults: tuple[FaultPart, ...] = ()
    lost: tuple[str, ...] = ()
    flights: tuple[FlightPart, ...] = ()
    swaps: int = 0
    """Of the battery, between flights."""
    inspection: InspectionPart = InspectionPart()
    blade_shape: ShapePart | None = None
    course: Course | None = None
    code: str = ""
    truth: TruthPart | None = None
    errors: ErrorsPart | None = None

    @property
    def begin_s(self) -> float:
        """Mission time at which the mission was asked for: where the first idling ends."""
        first = self.phases[0] if self.phases else None
        if first is None:
            return 0.0
        return first.to_s if first.phase == "idle" else first.from_s


def read_mission(folder: Path) -> MissionFile:
    """Read the mission.json of a mission folder. Raises `NotAMission`."""
    path = folder / MISSION
    try:
        return MissionFile.model_validate_json(path.read_bytes())
    except (FileNotFoundError, NotADirectoryError) as error:
        raise NotAMission(f"{folder} holds no {MISSION}") from error
    except ValidationError as error:
        raise NotAMission(f"{path}: {first_fault(error)}") from error
