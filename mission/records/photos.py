"""Fetch a photo from the camera, judge it, and store it with its record."""

from __future__ import annotations

import hashlib
import logging
import math
import time
import urllib.error
import urllib.request
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from config.settings import Settings
from config.turbine import Turbine
from mission.records.files import PHOTOS, photo_name, write_whole
from mission.records.jpeg_segments import NotAJpeg, picture_data
from mission.records.photo_judge import Verdict, judge
from mission.records.photo_metadata import with_metadata
from mission.records.photo_moment import PhotoMoment, Sighting, moment_of
from mission.records.photo_record import PhotoRecord, view_record
from mission.records.photo_view import PhotoView, view_of
from mission.remote.messages import PhotoTakenMessage
from perception.geometry import heading_from_enu_yaw, rotation_from_quaternion
from perception.values import Bytes, Float

__all__ = ["NotAJpeg", "PhotoLost", "PhotoSite", "StoredPhoto", "fetch", "store"]

log = logging.getLogger(__name__)

FETCH_TRIES = 4
FETCH_TIMEOUT_S = 10.0
FETCH_WAIT_S = 0.2


class PhotoLost(OSError):
    """The camera does not give the photo out."""


@dataclass(frozen=True, slots=True)
class StoredPhoto:
    """A photo in the mission folder."""

    record: PhotoRecord
    path: Path
    sightings: tuple[Sighting, ...] = ()
    """What the picture says of the vehicle's wander."""
    beside_w: Float | None = None
    """(3,) from the optical axis to the blade's middle, where the picture shows it."""


@dataclass(frozen=True, slots=True)
class PhotoSite:
    """What a photo is of, as far as it is known beforehand."""

    name: str
    turbine: Turbine | None = None
    serials: tuple[tuple[str, str], ...] = ()
    """Blade and serial."""


def fetch(url: str) -> bytes:
    """Return the photo's bytes; retries, waiting longer each time. Raises `PhotoLost`."""
    if not url.startswith(("http://", "https://")):
        raise PhotoLost(f"cannot fetch {url!r}: only http and https are known")
    last = ""
    for attempt in range(FETCH_TRIES):
        if attempt:
            time.sleep(FETCH_WAIT_S * 2 ** (attempt - 1))
        try:
            with urllib.request.urlopen(url, timeout=FETCH_TIMEOUT_S) as answer:  # noqa: S310 - checked above
                return bytes(answer.read())
        except (urllib.error.URLError, OSError) as error:
            last = str(error)
    raise PhotoLost(f"{url}: {last}")


def store(
    jpeg: bytes,
    taken: PhotoTakenMessage,
    site: PhotoSite,
    settings: Settings,
    folder: Path,
    moment: PhotoMoment | None = None,
    seen_before: dict[str, int] | None = None,
) -> StoredPhoto:
    """Judge a photo and write it, with its sidecar, below ``folder``. Raises `NotAJpeg`.

    ``moment``: what was known when it was taken, where more was heard than the message tells;
    ``seen_before``: digests of pictures and the photos they came with, completed here.
    """
    data = np.frombuffer(jpeg, np.uint8)
    grey = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    if grey is None:
        raise NotAJpeg("the picture cannot be decoded")
    picture: Bytes = np.asarray(grey, np.uint8)
    now = moment_of(taken) if moment is None else moment
    view = _view(now, site.turbine, settings, picture)
    foot = None if taken.foot_w is None else np.array(taken.foot_w)
    verdict = judge(picture, view, now, foot, taken.shutter_s, settings)
    again = _again(jpeg, taken.command.photo_id, {} if seen_before is None else seen_before)
    fault = verdict.fault or ("" if again is None else f"the same picture as photo {again}")
    record = _record(taken, site, settings, now, view, verdict, fault)
    path = folder / record.file
    write_whole(path, with_metadata(jpeg, record, settings.camera))
    write_whole(path.with_suffix(".json"), record.sidecar())
    return StoredPhoto(record, path, view.sightings, verdict.beside_w)


def _view(
    moment: PhotoMoment, turbine: Turbine | None, settings: Settings, picture: Bytes
) -> PhotoView:
    """Return what the picture shows; a blade that cannot be placed loses no photo."""
    try:
        return view_of(moment, turbine, settings, picture)
    except (ValueError, ArithmeticError, IndexError, np.linalg.LinAlgError):
        log.exception("what a photo shows cannot be told")
        return view_of(replace(moment, blade=None), None, settings, picture)


def _again(jpeg: bytes, photo_id: int, seen_before: dict[str, int]) -> int | None:
    """Return which photo came with the very same picture: a camera that is stuck sends it anew."""
    digest = hashlib.sha256(picture_data(jpeg)).hexdigest()
    first = seen_before.setdefault(digest, photo_id)
    return None if first == photo_id else first


def _record(
    taken: PhotoTakenMessage,
    site: PhotoSite,
    settings: Settings,
    moment: PhotoMoment,
    view: PhotoView,
    verdict: Verdict,
    fault: str,
) -> PhotoRecord:
    command, camera, lens, quality = taken.command, settings.camera, view.lens, verdict.quality
    metre = command.metre if view.metre_m is None else view.metre_m
    name = photo_name(site.name, command.blade, command.side, max(metre, 0.0), taken.utc)
    range_m = taken.distance_m if view.range_m is None else view.range_m
    gsd_mm = None if range_m is None else range_m * 1000 / lens.focal_px
    pitch_deg, roll_deg, yaw_deg = _flight_angles(moment)
    positioning = settings.positioning
    return PhotoRecord(
        photo_id=command.photo_id,
        still_index=taken.index,
        file=str(Path(PHOTOS) / command.blade / command.side / name),
        kept=not fault,
        reason=fault,
        marks=command.marks,
        turbine=site.name,
        blade=command.blade,
        serial=dict(site.serials).get(command.blade, ""),
        side=command.side,
        metre=round(metre, 3),
        metre_sigma_m=None if view.metre_sigma_m is None else round(view.metre_sigma_m, 3),
        metre_asked=round(command.metre, 3),
        utc=taken.utc,
        mission_s=taken.stamp_s,
        distance_m=taken.distance_m,
        gsd_mm=gsd_mm,
        gsd_full_mm=None if gsd_mm is None else gsd_mm * lens.width_px / camera.width_px,
        width_px=lens.width_px,
        height_px=lens.height_px,
        focal_px=lens.focal_px,
        position_w=_xyz(moment),
        quaternion_wb=moment.quaternion_wb,
        gimbal_yaw_deg=heading_from_enu_yaw(moment.gimbal_yaw_rad),
        gimbal_pitch_deg=math.degrees(moment.gimbal_pitch_rad),
        flight_yaw_deg=yaw_deg,
        flight_pitch_deg=pitch_deg,
        flight_roll_deg=roll_deg,
        latitude_deg=taken.latitude_deg,
        longitude_deg=taken.longitude_deg,
        altitude_m=taken.altitude_m,
        relative_altitude_m=float(moment.position_w[2]) - _home_z_m(taken),
        gps_sigma_m=math.hypot(positioning.noise_sigma_m, positioning.wander_sigma_m),
        ev=taken.ev,
        shutter_s=taken.shutter_s,
        mean_grey=None if quality is None else quality.mean_grey,
        blade_grey=None if quality is None else quality.blade_grey,
        exposure_in_range=None if quality is None else quality.in_range,
        sharpness=None if quality is None else quality.sharpness,
        aim_error=verdict.aim_error,
        blade_share=verdict.blade_share,
        blur_px=verdict.blur_px,
        view=view_record(view),
    )


def _home_z_m(taken: PhotoTakenMessage) -> float:
    """Return where the take-off point lies in the autopilot's own frame."""
    return 0.0 if taken.height_m is None else taken.position_w[2] - taken.height_m


def _flight_angles(moment: PhotoMoment) -> tuple[float, float, float]:
    """Return pitch (nose up), roll (right side down) and compass heading of the body, degrees."""
    body = rotation_from_quaternion(moment.quaternion_wb)
    forward, left = body[:, 0], body[:, 1]
    pitch = math.degrees(math.asin(max(-1.0, min(1.0, float(forward[2])))))
    roll = math.degrees(math.atan2(float(left[2]), float(body[2, 2])))
    return pitch, roll, heading_from_enu_yaw(math.atan2(forward[1], forward[0]))


def _xyz(moment: PhotoMoment) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in moment.position_w)
    return x, y, z
