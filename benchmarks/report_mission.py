"""The folder of a large inspection, as the recorder writes it: many photos of 20 megapixels.

The pictures are noise, which no JPEG makes small: a page of real photos weighs less.
"""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np

from config.presets import load_turbine
from config.settings import Settings
from config.turbine import Site
from mission.flight.command import MissionState, Phase, PhotoCommand
from mission.flight.observation import BladeEstimate, RotorEstimate, Vec3
from mission.flight.report import MissionReport, PassReport, PhaseTime
from mission.records.course import Course
from mission.records.photo_record import PhotoRecord
from mission.records.photos import PhotoSite, store
from mission.records.summary import close_folder
from mission.remote.messages import FlightReport, PhotoTakenMessage

_SIDES = ("PS", "SS", "LE", "TE")
_TURBINE = "iea-3.4-130"
_DISTANCE_M = 12.0


def write_mission(folder: Path, photos: int) -> None:
    """Write mission.json, photos with their records and all else for so many photos."""
    settings = Settings(sites=(Site(name="large", turbine=_TURBINE),))
    turbine = load_turbine(_TURBINE)
    length_m = turbine.blade_length_m
    places = [
        (blade, side, length_m * (index + 0.5) / -(-photos // 12))
        for blade in "ABC"
        for side in _SIDES
        for index in range(-(-photos // 12))
    ][:photos]
    records = _photos(folder, settings, PhotoSite("large", turbine, ()), places)
    passes = tuple(_pass(blade, side, length_m, places) for blade in "ABC" for side in _SIDES)
    seconds = 8 * photos
    report = MissionReport(
        state=MissionState.COMPLETED,
        words="landed",
        started_s=0.0,
        duration_s=float(seconds),
        phases=(PhaseTime(Phase.TRACK, 0.0, float(seconds)),),
        rotor=_rotor(),
        iterations=3,
        passes=passes,
        events=(),
    )
    message = FlightReport(
        report=report,
        site="large",
        turbine=_TURBINE,
        operator="A. Person",
        rotor_locked=True,
        started_utc="2026-03-01T10:14:00+00:00",
        tower_foot_w=(0.0, 0.0, 0.0),
    )
    close_folder(folder, message, records, [], settings, _course(seconds))


def _photos(
    folder: Path, settings: Settings, site: PhotoSite, places: list[tuple[str, str, float]]
) -> list[PhotoRecord]:
    """Store the first photo as the recorder does; the others are the same file by other names."""
    camera = settings.camera
    draw = np.random.default_rng(1)
    # As coarse as the pixels of a thumbnail, so that reducing the picture does not smooth it.
    rows, columns = camera.height_px // 16, camera.width_px // 16
    noise = draw.normal(135, 40, (rows, columns, 3)).clip(0, 255).astype(np.uint8)
    picture = cv2.resize(
        noise, (camera.width_px, camera.height_px), interpolation=cv2.INTER_NEAREST
    )
    jpeg = cv2.imencode(".jpg", picture)[1].tobytes()
    blade, side, metre = places[0]
    first = store(jpeg, _taken(blade, side, metre), site, settings, folder).record
    records = [first.model_copy(update={"kept": True, "reason": ""})]
    for number, (blade, side, metre) in enumerate(places[1:], 2):
        name = f"photos/{blade}/{side}/large_{blade}_{side}_{metre:05.1f}_{number:03}.jpg"
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        os.link(folder / first.file, folder / name)
        told = {"file": name, "photo_id": number, "blade": blade, "side": side, "metre": metre}
        records.append(records[0].model_copy(update=told))
        (folder / name).with_suffix(".json").write_bytes(records[-1].sidecar())
    return records


def _taken(blade: str, side: str, metre: float) -> PhotoTakenMessage:
    return PhotoTakenMessage(
        command=PhotoCommand(1, blade, side, metre, _DISTANCE_M),
        url="http://camera/1.jpg",
        index=1,
        stamp_s=100.0,
        utc="2026-03-01T10:20:10.500Z",
        position_w=(10.0, 8.0, 80.0),
        quaternion_wb=(1.0, 0.0, 0.0, 0.0),
        gimbal_yaw_rad=0.0,
        gimbal_pitch_rad=0.1,
        foot_w=(10.0, 20.0, 80.0),
        distance_m=_DISTANCE_M,
        latitude_deg=54.0,
        longitude_deg=6.5,
        altitude_m=100.0,
    )


def _pass(
    blade: str, side: str, length_m: float, places: list[tuple[str, str, float]]
) -> PassReport:
    count = sum(1 for place in places if place[:2] == (blade, side))
    return PassReport(
        blade=blade,
        side=side,
        length_m=length_m,
        planned_m=length_m,
        photographed_m=length_m,
        distance_mean_m=_DISTANCE_M,
        distance_rms_error_m=0.2,
        distance_min_m=11.5,
        clearance_min_m=9.5,
        photos=count,
        rejected=0,
        unseen=(),
        stretches=((0.0, length_m),),
    )


def _rotor() -> RotorEstimate:
    directions: tuple[Vec3, ...] = ((0.87, 0.0, -0.5), (0.0, 0.0, 1.0), (-0.87, 0.0, -0.5))
    blades = tuple(
        BladeEstimate(name=name, direction_w=direction, pitch_deg=88.0)
        for name, direction in zip("ABC", directions, strict=True)
    )
    return RotorEstimate(
        stamp_s=50.0,
        sequence=3,
        stop_angle_deg=60.0,
        sigma_deg=0.1,
        reference="tower",
        hub_w=(0.0, 4.0, 110.0),
        normal_w=(0.0, 1.0, 0.0),
        cone_deg=2.0,
        blades=blades,
        method="rotor_fit",
    )


def _course(seconds: int) -> Course:
    every = tuple(float(second) for second in range(seconds))
    return Course(
        mission_s=every,
        distance_m=tuple(_DISTANCE_M for _ in every),
        clearance_m=tuple(10.0 for _ in every),
        height_m=tuple(80.0 for _ in every),
        battery=tuple(1.0 - 0.8 * second / seconds for second in every),
    )
