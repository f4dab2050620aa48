"""Photos that exist at the camera and are not stored yet, with what was known at their moment.

Each is written down before it is fetched and struck out when it is stored: a recorder that is
killed in between leaves behind what the next one needs to fetch it.
"""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from mission.flight.observation import BladeTrack
from mission.records.files import write_whole
from mission.records.photo_moment import BladeThen, PhotoMoment
from mission.remote.messages import PhotoTakenMessage

log = logging.getLogger(__name__)

PENDING = "pending"

Xyz = tuple[float, float, float]


class _Part(BaseModel):
    # What was not measured is not a number, and stays so.
    model_config = ConfigDict(frozen=True, ser_json_inf_nan="strings")


class _Blade(_Part):
    hub_w: Xyz
    normal_w: Xyz
    root_w: Xyz
    axis_w: Xyz
    pitch_deg: float | None
    track: BladeTrack | None
    drift_w: Xyz
    drift_covariance: tuple[Xyz, Xyz, Xyz]


class _Moment(_Part):
    position_w: Xyz
    quaternion_wb: tuple[float, float, float, float]
    velocity_w: Xyz
    gimbal_yaw_rad: float
    gimbal_pitch_rad: float
    turning_rps: float
    blade: _Blade | None


class _Pending(_Part):
    taken: PhotoTakenMessage
    moment: _Moment | None


def note_pending(folder: Path, taken: PhotoTakenMessage, moment: PhotoMoment | None) -> None:
    """Write down a photo that is going to be fetched."""
    told = None if moment is None else _Moment.model_validate(_plain(moment))
    text = _Pending(taken=taken, moment=told).model_dump_json()
    write_whole(_file(folder, taken), text.encode())


def strike_out(folder: Path, taken: PhotoTakenMessage) -> None:
    """The photo is stored."""
    _file(folder, taken).unlink(missing_ok=True)


def read_pending(folder: Path) -> list[tuple[PhotoTakenMessage, PhotoMoment | None]]:
    """Return the photos that were never stored, by number."""
    found = []
    for file in (folder / PENDING).glob("*.json"):
        try:
            one = _Pending.model_validate_json(file.read_bytes())
        except (OSError, ValidationError) as error:
            log.warning("%s is no photo that waits: %s", file, error)
            continue
        found.append((one.taken, None if one.moment is None else _moment(one.moment)))
    return sorted(found, key=lambda pair: pair[0].command.photo_id)


def _file(folder: Path, taken: PhotoTakenMessage) -> Path:
    return folder / PENDING / f"{taken.command.photo_id}.json"


def _plain(moment: PhotoMoment) -> dict[str, object]:
    blade = moment.blade
    return {
        "position_w": moment.position_w.tolist(),
        "quaternion_wb": moment.quaternion_wb,
        "velocity_w": moment.velocity_w.tolist(),
        "gimbal_yaw_rad": moment.gimbal_yaw_rad,
        "gimbal_pitch_rad": moment.gimbal_pitch_rad,
        "turning_rps": moment.turning_rps,
        "blade": None
        if blade is None
        else {
            "hub_w": blade.hub_w.tolist(),
            "normal_w": blade.normal_w.tolist(),
            "root_w": blade.root_w.tolist(),
            "axis_w": blade.axis_w.tolist(),
            "pitch_deg": blade.pitch_deg,
            "track": blade.track,
            "drift_w": blade.drift_w.tolist(),
            "drift_covariance": blade.drift_covariance.tolist(),
        },
    }


def _moment(told: _Moment) -> PhotoMoment:
    blade = told.blade
    return PhotoMoment(
        position_w=np.array(told.position_w),
        quaternion_wb=told.quaternion_wb,
        velocity_w=np.array(told.velocity_w),
        gimbal_yaw_rad=told.gimbal_yaw_rad,
        gimbal_pitch_rad=told.gimbal_pitch_rad,
        turning_rps=told.turning_rps,
        blade=None
        if blade is None
        else BladeThen(
            hub_w=np.array(blade.hub_w),
            normal_w=np.array(blade.normal_w),
            root_w=np.array(blade.root_w),
            axis_w=np.array(blade.axis_w),
            pitch_deg=blade.pitch_deg,
            track=blade.track,
            drift_w=np.array(blade.drift_w),
            drift_covariance=np.array(blade.drift_covariance),
        ),
    )
