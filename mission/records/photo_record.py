"""The sidecar of a photo: everything known of it, as it is written and read again."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from config.errors import first_fault
from mission.records.files import PHOTOS
from mission.records.photo_view import PhotoView
from perception.blade_in_picture import BladeStations, clipped, outline_px, see
from perception.geometry import quaternion_from_rotation, rotation_from_quaternion
from perception.lens import Lens
from perception.values import CameraPose, Float

log = logging.getLogger(__name__)

Xyz = tuple[float, float, float]
Row = tuple[float | None, ...]

#: The mapping is given at so many columns and rows of pixels, edges included.
GRID = (13, 10)


class NotARecord(ValueError):
    """A sidecar is missing or cannot be read."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Station(_Part):
    """One section of the blade before the camera; world as the photo's `position_w`."""

    metre: float
    centre_w: Xyz
    """Where the pitch axis passes."""
    leading_w: Xyz
    """Unit, towards the leading edge."""
    pressure_w: Xyz
    """Unit, outward on the pressure side."""
    chord_m: float
    thickness: float
    """Share of the chord."""
    pitch_axis: float
    """Share of the chord between leading edge and pitch axis."""


class Mapping(_Part):
    """What pixels show, at a grid of them; null beside the blade. `locate` computes any pixel."""

    columns_px: tuple[float, ...]
    rows_px: tuple[float, ...]
    metre: tuple[Row, ...]
    """A row of pixels each."""
    chord: tuple[Row, ...]
    """0 at the leading edge, 1 at the trailing edge."""
    mm_per_px: tuple[Row, ...]
    """At right angles to the line of sight."""


class View(_Part):
    """Camera, pose and blade of one photo: enough to say what each pixel shows."""

    matrix: tuple[Xyz, Xyz, Xyz]
    """Camera matrix of the file as stored; pixel (0, 0) is the first pixel's outer corner."""
    distortion: tuple[float, float, float, float, float]
    """k1, k2, p1, p2, k3 (Brown and Conrady, OpenCV's order)."""
    position_w: Xyz
    """Optical centre, local ENU of the flight, metres."""
    quaternion_wc: tuple[float, float, float, float]
    """w x y z: turns optical vectors (right, down, ahead) into the world."""
    position_sigma_m: Xyz
    """Relative to the rotor."""
    yaw_sigma_deg: float
    pitch_sigma_deg: float
    across_sigma_m: float | None = None
    """How far the blade may lie beside where it is drawn."""
    tracked: bool = False
    """The LiDAR saw the blade at that moment."""
    matched: bool = False
    """The outline was laid on the blade's edges in the picture."""
    blade_length_m: float | None = None
    stations: tuple[Station, ...] = ()
    """Sections of the blade before the camera."""
    mask_px: tuple[tuple[float, float], ...] = ()
    """Outline of the blade in the picture: a polygon."""
    mapping: Mapping | None = None

    def camera(self) -> CameraPose:
        """Return the camera's pose."""
        return CameraPose(
            0.0, np.array(self.position_w), rotation_from_quaternion(self.quaternion_wc)
        )

    def lens(self, width_px: int, height_px: int) -> Lens:
        """Return the lens of the file as stored."""
        return Lens(np.array(self.matrix), np.array(self.distortion), width_px, height_px)

    def blade(self) -> BladeStations | None:
        """Return the blade's sections; None where they are not known."""
        if len(self.stations) < 2:
            return None
        return BladeStations(
            metre_m=np.array([one.metre for one in self.stations]),
            centre_w=np.array([one.centre_w for one in self.stations]),
            leading_w=np.array([one.leading_w for one in self.stations]),
            pressure_w=np.array([one.pressure_w for one in self.stations]),
            chord_m=np.array([one.chord_m for one in self.stations]),
            thickness=np.array([one.thickness for one in self.stations]),
            pitch_axis=np.array([one.pitch_axis for one in self.stations]),
        )


class PhotoRecord(BaseModel):
    """The sidecar of one photo: everything known of it."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    version: int = 2
    photo_id: int
    still_index: int
    file: str
    """Relative to the mission folder."""
    kept: bool
    reason: str
    """Why it was rejected; empty when kept."""
    marks: tuple[str, ...]
    turbine: str
    blade: str
    serial: str = ""
    """Of the physical blade; empty where it is not known."""
    side: str
    metre: float
    """Where the optical axis meets the blade, along its undeflected axis from the root flange."""
    metre_sigma_m: float | None = None
    metre_asked: float | None = None
    """Where the flight wanted it."""
    utc: str
    mission_s: float
    distance_m: float | None
    """From the vehicle to the blade's axis."""
    gsd_mm: float | None
    """Of the file as stored."""
    gsd_full_mm: float | None
    """At the camera's full size."""
    width_px: int
    height_px: int
    focal_px: float
    position_w: Xyz
    """Of the vehicle's body, local ENU, metres."""
    quaternion_wb: tuple[float, float, float, float]
    gimbal_yaw_deg: float
    """Compass heading of the optical axis."""
    gimbal_pitch_deg: float
    flight_yaw_deg: float
    flight_pitch_deg: float | None = None
    flight_roll_deg: float | None = None
    latitude_deg: float | None
    longitude_deg: float | None
    altitude_m: float | None
    relative_altitude_m: float
    gps_sigma_m: float | None = None
    """Of latitude, longitude and altitude, per axis."""
    ev: float | None
    shutter_s: float | None
    mean_grey: float | None
    """Of the blade in the middle of the stored picture, which is metered too."""
    blade_grey: float | None = None
    """Of all of the blade in it, where its outline was laid on its edges."""
    exposure_in_range: bool | None
    sharpness: float | None
    aim_error: float | None = None
    """Of the blade's middle from the picture's centre, as a share of the width."""
    blade_share: float | None = None
    """Share of the picture that the blade fills."""
    blur_px: float | None = None
    """Motion blur as the vehicle's and the gimbal's motion say, pixels at the full size."""
    view: View | None = None

    def sidecar(self) -> bytes:
        """Return the JSON text, a line for each of the record's own fields."""
        fields = self.model_dump(mode="json")
        lines = (f' "{name}": {json.dumps(value)}' for name, value in fields.items())
        return ("{\n" + ",\n".join(lines) + "\n}\n").encode()


def read_record(photo: Path) -> PhotoRecord:
    """Return the record beside a photo. Raises `NotARecord`."""
    path = photo.with_suffix(".json")
    try:
        return PhotoRecord.model_validate_json(path.read_bytes())
    except FileNotFoundError as error:
        raise NotARecord(f"{photo} has no sidecar {path.name} beside it") from error
    except (OSError, ValidationError) as error:
        words = first_fault(error) if isinstance(error, ValidationError) else str(error)
        raise NotARecord(f"{path} is not the sidecar of a photo: {words}") from error


def view_record(view: PhotoView) -> View:
    """Return the part of a sidecar that says what each pixel shows."""
    lens, stations = view.lens, view.stations
    matrix = lens.matrix.tolist()
    camera = view.camera
    sigma = np.sqrt(np.diag(view.position_covariance))
    mask: Float = np.zeros((0, 2))
    if stations is not None:
        mask = clipped(outline_px(stations, camera, lens), lens.width_px, lens.height_px)
    return View(
        matrix=(tuple(matrix[0]), tuple(matrix[1]), tuple(matrix[2])),
        distortion=tuple(lens.distortion.tolist()),
        position_w=_xyz(camera.position_w, 4),
        quaternion_wc=tuple(quaternion_from_rotation(camera.rotation_wc).round(8).tolist()),
        position_sigma_m=_xyz(sigma, 3),
        yaw_sigma_deg=round(float(np.degrees(view.yaw_sigma_rad)), 3),
        pitch_sigma_deg=round(float(np.degrees(view.pitch_sigma_rad)), 3),
        across_sigma_m=view.across_sigma_m,
        tracked=view.tracked,
        matched=view.matched,
        blade_length_m=view.blade_length_m,
        stations=() if stations is None else _stations(stations),
        mask_px=tuple((round(float(x), 1), round(float(y), 1)) for x, y in mask),
        mapping=None if stations is None else _mapping(stations, camera, lens),
    )


def _stations(stations: BladeStations) -> tuple[Station, ...]:
    return tuple(
        Station(
            metre=round(float(stations.metre_m[k]), 4),
            centre_w=_xyz(stations.centre_w[k], 4),
            leading_w=_xyz(stations.leading_w[k], 6),
            pressure_w=_xyz(stations.pressure_w[k], 6),
            chord_m=round(float(stations.chord_m[k]), 4),
            thickness=round(float(stations.thickness[k]), 4),
            pitch_axis=round(float(stations.pitch_axis[k]), 4),
        )
        for k in range(len(stations.metre_m))
    )


def _mapping(stations: BladeStations, camera: CameraPose, lens: Lens) -> Mapping:
    columns = np.linspace(0, lens.width_px, GRID[0])
    rows = np.linspace(0, lens.height_px, GRID[1])
    x, y = np.meshgrid(columns, rows)
    seen = see(stations, np.column_stack([x.ravel(), y.ravel()]), camera, lens)

    def table(values: Float, digits: int) -> tuple[Row, ...]:
        shaped = values.reshape(GRID[1], GRID[0])
        return tuple(
            tuple(None if np.isnan(one) else round(float(one), digits) for one in row)
            for row in shaped
        )

    return Mapping(
        columns_px=tuple(columns.round(1).tolist()),
        rows_px=tuple(rows.round(1).tolist()),
        metre=table(seen.metre_m, 3),
        chord=table(seen.chord_share, 3),
        mm_per_px=table(seen.depth_m * 1000 / lens.focal_px, 3),
    )


def _xyz(values: Float, digits: int) -> Xyz:
    x, y, z = (round(float(value), digits) for value in values)
    return x, y, z


def stored_records(folder: Path) -> list[PhotoRecord]:
    """Return the records of photos that a mission folder already holds, by their number."""
    records = []
    for path in (folder / PHOTOS).glob("*/*/*.json"):
        try:
            records.append(PhotoRecord.model_validate_json(path.read_bytes()))
        except ValueError as error:
            log.warning("%s is no photo's record: %s", path, error)
    return sorted(records, key=lambda record: record.photo_id)
