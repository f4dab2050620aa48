"""Fetch a photo from the camera, judge it, and store it with its record."""

from __future__ import annotations

import math
import time
import urllib.error
import urllib.request
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from config.settings import Settings
from mission.records.files import PHOTOS, photo_name, write_whole
from mission.records.photo_metadata import NotAJpeg, PhotoRecord, with_metadata
from mission.remote.messages import PhotoTakenMessage
from perception.geometry import (
    camera_looking_along,
    heading_from_enu_yaw,
    pinhole_matrix,
    rotation_from_quaternion,
)
from perception.photo_quality import PhotoQuality, judge_photo
from perception.values import Float

FETCH_TRIES = 3
FETCH_TIMEOUT_S = 10.0


class PhotoLost(OSError):
    """The camera does not give the photo out."""


@dataclass(frozen=True, slots=True)
class StoredPhoto:
    """A photo in the mission folder."""

    record: PhotoRecord
    path: Path


def fetch(url: str) -> bytes:
    """Return the photo's bytes; retries. Raises `PhotoLost`."""
    if not url.startswith(("http://", "https://")):
        raise PhotoLost(f"cannot fetch {url!r}: only http and https are known")
    last = ""
    for attempt in range(FETCH_TRIES):
        try:
            with urllib.request.urlopen(url, timeout=FETCH_TIMEOUT_S) as answer:  # noqa: S310 - checked above
                return bytes(answer.read())
        except (urllib.error.URLError, OSError) as error:
            last = str(error)
            time.sleep(0.1 * (attempt + 1))
    raise PhotoLost(f"{url}: {last}")


def store(
    jpeg: bytes, taken: PhotoTakenMessage, turbine: str, settings: Settings, folder: Path
) -> StoredPhoto:
    """Judge a photo and write it, with its sidecar, below ``folder``. Raises `NotAJpeg`."""
    data = np.frombuffer(jpeg, np.uint8)
    grey = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    if grey is None:
        raise NotAJpeg("the picture cannot be decoded")
    height_px, width_px = grey.shape
    camera = settings.camera
    focal_px = camera.focal_length_mm / camera.sensor_width_mm * width_px
    centre = _foot_in_picture(taken, settings, focal_px, width_px, height_px)
    radius_px = settings.exposure.disc_radius * width_px
    range_grey = (settings.exposure.min_grey, settings.exposure.max_grey)
    quality = judge_photo(np.asarray(grey, np.uint8), centre, radius_px, range_grey)
    reason = _fault(quality)
    command = taken.command
    relative = (
        Path(PHOTOS)
        / command.blade
        / command.side
        / photo_name(turbine, command.blade, command.side, command.metre, taken.utc)
    )
    distance_m = taken.distance_m
    gsd_mm = None if distance_m is None else distance_m * 1000 / focal_px
    record = PhotoRecord(
        photo_id=command.photo_id,
        still_index=taken.index,
        file=str(relative),
        kept=not reason,
        reason=reason,
        marks=command.marks,
        turbine=turbine,
        blade=command.blade,
        side=command.side,
        metre=round(command.metre, 3),
        utc=taken.utc,
        mission_s=taken.stamp_s,
        distance_m=distance_m,
        gsd_mm=gsd_mm,
        gsd_full_mm=None if gsd_mm is None else gsd_mm * width_px / camera.width_px,
        width_px=width_px,
        height_px=height_px,
        focal_px=focal_px,
        position_w=taken.position_w,
        quaternion_wb=taken.quaternion_wb,
        gimbal_yaw_deg=heading_from_enu_yaw(taken.gimbal_yaw_rad),
        gimbal_pitch_deg=math.degrees(taken.gimbal_pitch_rad),
        flight_yaw_deg=_heading(taken),
        latitude_deg=taken.latitude_deg,
        longitude_deg=taken.longitude_deg,
        altitude_m=taken.altitude_m,
        relative_altitude_m=taken.position_w[2],
        ev=taken.ev,
        shutter_s=taken.shutter_s,
        mean_grey=None if quality is None else quality.mean_grey,
        exposure_in_range=None if quality is None else quality.in_range,
        sharpness=None if quality is None else quality.sharpness,
    )
    path = folder / relative
    write_whole(path, with_metadata(jpeg, record, camera))
    write_whole(path.with_suffix(".json"), record.model_dump_json(indent=1).encode())
    return StoredPhoto(record, path)


def _fault(quality: PhotoQuality | None) -> str:
    if quality is None:
        return "the blade is not in the picture"
    if quality.clipped > 0.5:
        return "the blade is overexposed beyond recovery"
    if quality.mean_grey < 5:
        return "the picture is black"
    return ""


def _heading(taken: PhotoTakenMessage) -> float:
    forward = rotation_from_quaternion(taken.quaternion_wb)[:, 0]
    return heading_from_enu_yaw(math.atan2(forward[1], forward[0]))


def _foot_in_picture(
    taken: PhotoTakenMessage, settings: Settings, focal_px: float, width_px: int, height_px: int
) -> tuple[float, float]:
    """Return where the blade's foot lies in the picture (pixels); its centre where unknown."""
    centre = (width_px / 2, height_px / 2)
    if taken.foot_w is None:
        return centre
    body = rotation_from_quaternion(taken.quaternion_wb)
    eye_w = np.asarray(taken.position_w) + body @ np.asarray(settings.camera.offset_m)
    yaw, pitch = taken.gimbal_yaw_rad, taken.gimbal_pitch_rad
    direction = (
        math.cos(pitch) * math.cos(yaw),
        math.cos(pitch) * math.sin(yaw),
        math.sin(pitch),
    )
    seen_c: Float = camera_looking_along(direction).T @ (np.asarray(taken.foot_w) - eye_w)
    if seen_c[2] <= 0.1:
        return (-1e9, -1e9)
    pixel = pinhole_matrix(focal_px, width_px, height_px) @ (seen_c / seen_c[2])
    return float(pixel[0]), float(pixel[1])
