"""mission.json: what the flight reported and what was stored; in simulation the truth beside."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np

from config.errors import ConfigError
from config.presets import load_turbine
from config.settings import Settings
from mission.flight.observation import RotorEstimate
from mission.flight.report import PassReport
from mission.records.code_digest import code_digest
from mission.records.course import Course
from mission.records.files import (
    CONFIG,
    EVENTS,
    GEOJSON,
    MANIFEST,
    MISSION,
    manifest,
    write_whole,
)
from mission.records.flights import FlightRecord, swaps, told
from mission.records.photo_record import PhotoRecord
from mission.remote.messages import FlightReport
from perception.geometry import stop_angle_difference_deg
from perception.rotor import blade_angles_deg

SCHEMA = 1

Json = dict[str, object]


def close_folder(
    folder: Path,
    report: FlightReport,
    records: Sequence[PhotoRecord],
    lost: Sequence[str],
    settings: Settings,
    course: Course | None = None,
    not_recorded: Sequence[str] = (),
    flights: Sequence[FlightRecord] = (),
) -> None:
    """Write mission.json, photos.geojson, the manifest and the report of a finished mission.

    ``lost``: a sentence for each photo that was lost; ``not_recorded``: what else is missing;
    ``flights``: all that it took, of which ``report`` and ``course`` are the sum.
    """
    records = sorted(records, key=lambda record: record.photo_id)
    mission = _mission(report, records, lost, settings)
    mission["lost"] = [*lost, *not_recorded]
    mission["flights"], mission["swaps"] = told(flights), swaps(flights)
    mission["course"] = None if course is None else course.model_dump(mode="json")
    write_whole(folder / MISSION, json.dumps(mission, indent=1).encode())
    write_whole(folder / GEOJSON, json.dumps(_geojson(records)).encode())
    paths = [folder / record.file for record in records]
    paths += [path.with_suffix(".json") for path in paths]
    paths += [path for name in (CONFIG, EVENTS, GEOJSON) if (path := folder / name).exists()]
    write_whole(folder / MANIFEST, manifest(folder, paths).encode())
    # Last: everything is stored even where it cannot be rendered.
    _render(folder)


def _render(folder: Path) -> None:
    # Only here: a recorder is ready sooner without what renders its report.
    from mission.records.report import write_report

    write_report(folder)


def add_truth(folder: Path, truth: Mapping[str, object]) -> Json:
    """Put the simulated world's truth into mission.json, render the report again, return it all."""
    path = folder / MISSION
    mission: Json = json.loads(path.read_text())
    timing = dict(truth)
    measured = timing.pop("timing", None)
    mission["truth"] = timing
    mission["simulated"] = True
    flight_timing = mission["timing"]
    if isinstance(measured, Mapping) and isinstance(flight_timing, dict):
        # Setpoint gaps are measured by arrival at the autopilot: the field's word counts.
        flight_timing.update(measured)
    errors = _errors(mission, truth)
    metres = truth.get("still_metres")
    if isinstance(metres, Mapping):
        errors["photo_metres"] = metre_errors(mission["photo_list"], metres)
    mission["errors"] = errors
    write_whole(path, json.dumps(mission, indent=1).encode())
    _render(folder)
    return mission


def _errors(mission: Json, truth: Mapping[str, object]) -> Json:
    """Measured less true: the stop angle, the hub, the shaft's direction, each blade's pitch."""
    errors: Json = {}
    rotor = mission.get("rotor")
    if not isinstance(rotor, dict):
        return errors
    angle = truth.get("stop_angle_deg")
    if isinstance(angle, int | float):
        errors["stop_angle_deg"] = stop_angle_difference_deg(rotor["stop_angle_deg"], float(angle))
    hub, normal = truth.get("hub_m"), truth.get("normal")
    if isinstance(hub, list):
        errors["hub_m"] = math.dist(rotor["hub_m"], hub)
    if isinstance(normal, list):
        chord = math.dist(rotor["normal"], normal)
        errors["normal_deg"] = math.degrees(2 * math.asin(min(1.0, chord / 2)))
    pitch = truth.get("pitch_deg")
    if isinstance(pitch, Mapping):
        errors["pitch_deg"] = {
            blade["name"]: blade["pitch_deg"] - pitch[blade["name"]]
            for blade in rotor["blades"]
            if blade["pitch_deg"] is not None and blade["name"] in pitch
        }
    return errors


def metre_errors(photos: object, true: Mapping[str, Sequence[object]]) -> Json | None:
    """Return how well the kept photos' metres, and the uncertainty they state, hold.

    ``photos``: the photo list of mission.json; ``true``: blade and metre of each still's centre.
    """
    errors, scaled = [], []
    for photo in photos if isinstance(photos, list) else []:
        found = true.get(str(photo["still_index"]))
        if not photo["kept"] or found is None or found[0] != photo["blade"]:
            continue
        error = abs(photo["metre"] - float(str(found[1])))
        errors.append(error)
        if photo["metre_sigma_m"]:
            scaled.append(error / photo["metre_sigma_m"])
    if not errors:
        return None
    return {
        "photos": len(errors),
        "p50_m": float(np.quantile(errors, 0.5)),
        "p95_m": float(np.quantile(errors, 0.95)),
        "max_m": max(errors),
        # Of an honest normal sigma 0.68 and 0.95.
        "within_1_sigma": float(np.mean(np.array(scaled) < 1)) if scaled else None,
        "within_2_sigma": float(np.mean(np.array(scaled) < 2)) if scaled else None,
    }


def _mission(
    message: FlightReport, records: Sequence[PhotoRecord], lost: Sequence[str], settings: Settings
) -> Json:
    report = message.report
    kept = [record for record in records if record.kept]
    planned = sum(one.planned_m for one in report.passes)
    photographed = sum(one.photographed_m for one in report.passes)
    clearances = [one.clearance_min_m for one in report.passes if one.clearance_min_m is not None]
    gsds = [record.gsd_full_mm for record in kept if record.gsd_full_mm is not None]
    exposure = settings.exposure
    outside = [record for record in kept if record.exposure_in_range is False]
    return {
        "schema": SCHEMA,
        "version": version("bladescout"),
        "state": report.state,
        "words": report.words,
        "simulated": False,
        "vehicle": settings.vehicle,
        "site": message.site,
        "turbine": message.turbine,
        "operator": message.operator,
        "rotor_locked": message.rotor_locked,
        "started_utc": message.started_utc,
        "ended_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "duration_s": report.duration_s,
        "phases": [
            {"phase": one.phase, "from_s": one.from_s, "to_s": one.to_s} for one in report.phases
        ],
        "method": settings.estimation.method,
        "rotor": None if report.rotor is None else _rotor(report.rotor, message, report.iterations),
        "passes": [_pass(one, records) for one in report.passes],
        "coverage": photographed / planned if planned > 0 else 0.0,
        "clearance_m": {"min": min(clearances, default=None)},
        "gsd_mm": statistics.median(gsds) if gsds else None,
        "photos": {"kept": len(kept), "rejected": len(records) - len(kept), "lost": len(lost)},
        "photo_list": [
            {
                "file": one.file,
                "blade": one.blade,
                "side": one.side,
                "metre": one.metre,
                "metre_sigma_m": one.metre_sigma_m,
                "still_index": one.still_index,
                "kept": one.kept,
                "reason": one.reason,
                "mean_grey": one.mean_grey,
                "in_range": one.exposure_in_range,
                "ev": one.ev,
                "distance_m": one.distance_m,
                "gsd_mm": one.gsd_full_mm,
            }
            for one in records
        ],
        "exposure": {
            "method": exposure.method,
            "range": [exposure.min_grey, exposure.max_grey],
            "frames": message.frames,
            "frames_out_of_range": message.frames_out_of_range,
            "stills": len(kept),
            "stills_out_of_range": len(outside),
        },
        "timing": {
            "real_time_factor": message.real_time_factor,
            "setpoint_gap_ms": None,
            "tick_gap_ms": message.tick_gap_ms,
        },
        "faults": [
            {"mission_s": one.t_s, "event": one.name, "text": one.text}
            for one in report.events
            if one.severity >= 1
        ],
        "lost": list(lost),
        "inspection": _inspection(message.site, settings),
        "blade_shape": _blade_shape(message.site, settings),
        "code": code_digest(),
        "truth": None,
        "errors": None,
    }


def _inspection(site_name: str, settings: Settings) -> Json:
    """Who inspected with what: as the settings tell it."""
    told, camera = settings.report, settings.camera
    serials = next((s.blade_serials for s in settings.sites if s.name == site_name), {})
    lens = f"{camera.focal_length_mm:g} mm"
    return {
        **told.model_dump(mode="json", exclude={"templates", "logo", "lens"}),
        "camera": " ".join(filter(None, (camera.maker, camera.model))),
        "picture": f"{camera.width_px} x {camera.height_px} px, "
        f"sensor {camera.sensor_width_mm:g} x {camera.sensor_height_mm:g} mm",
        "lens": f"{told.lens}, {lens}" if told.lens else lens,
        "blade_serials": dict(serials),
        "wanted_distance_m": settings.tracking.distance_m,
        "min_clearance_m": settings.guard.min_clearance_m,
        "max_gsd_mm": settings.tracking.max_gsd_mm,
        "blades": list(settings.inspection.blades),
        "sides": list(settings.inspection.sides),
    }


def _blade_shape(site_name: str, settings: Settings) -> Json | None:
    """The blade's outline as the catalogue has it, to draw what was seen on it."""
    site = next((one for one in settings.sites if one.name == site_name), None)
    if site is None:
        return None
    try:
        blade = load_turbine(site.turbine, site.scale).blade
    except ConfigError:
        return None
    return {
        "span": list(blade.span),
        "chord_m": list(blade.chord_m),
        "thickness": list(blade.thickness),
        "pitch_axis": list(blade.pitch_axis),
    }


def _rotor(rotor: RotorEstimate, message: FlightReport, iterations: int) -> Json:
    angles = blade_angles_deg(rotor.stop_angle_deg)
    hub = [h - t for h, t in zip(rotor.hub_w, message.tower_foot_w, strict=True)]
    return {
        "stop_angle_deg": rotor.stop_angle_deg,
        "sigma_deg": rotor.sigma_deg,
        "reference": rotor.reference,
        "hub_m": hub,
        "normal": list(rotor.normal_w),
        "cone_deg": rotor.cone_deg,
        "blades": [
            {
                "name": blade.name,
                "angle_deg": angle,
                "direction": list(blade.direction_w),
                "pitch_deg": blade.pitch_deg,
            }
            for blade, angle in zip(
                sorted(rotor.blades, key=lambda blade: blade.name), angles, strict=True
            )
        ],
        "method": rotor.method,
        "iterations": iterations,
        "refusal": None,
    }


def _pass(one: PassReport, records: Sequence[PhotoRecord]) -> Json:
    mine = [r for r in records if (r.blade, r.side) == (one.blade, one.side)]
    gsds = [r.gsd_full_mm for r in mine if r.kept and r.gsd_full_mm is not None]
    reachable = one.length_m - sum(gap.to_m - gap.from_m for gap in one.unseen)
    seen_m = one.photographed_m
    if one.coverage is not None:
        # Of the skin itself, where the blade's pitch is known: what the field judges by.
        seen_m = one.coverage * one.length_m
    return {
        "blade": one.blade,
        "side": one.side,
        "length_m": one.length_m,
        "planned_m": one.planned_m,
        "coverage": min(1.0, seen_m / one.length_m) if one.length_m > 0 else 0.0,
        "coverage_reachable": min(1.0, seen_m / reachable) if reachable > 0 else 0.0,
        "photographed_m": [list(stretch) for stretch in one.stretches],
        "distance_m": {
            "mean": one.distance_mean_m,
            "rms_error": one.distance_rms_error_m,
            "min": one.distance_min_m,
        },
        "clearance_m": {"min": one.clearance_min_m},
        "gsd_mm": statistics.median(gsds) if gsds else None,
        "photos": one.photos,
        "rejected": one.rejected,
        "unseen": [
            {"from_m": gap.from_m, "to_m": gap.to_m, "reason": gap.reason} for gap in one.unseen
        ],
        "skipped": one.skipped,
    }


def _geojson(records: Sequence[PhotoRecord]) -> Json:
    features: list[Json] = [
        {
            "type": "Feature",
            "geometry": {
                "type": "Point",
                "coordinates": [record.longitude_deg, record.latitude_deg, record.altitude_m],
            },
            "properties": {
                "file": record.file,
                "blade": record.blade,
                "side": record.side,
                "serial": record.serial,
                "metre": record.metre,
                "metre_sigma_m": record.metre_sigma_m,
                "utc": record.utc,
                "kept": record.kept,
                "heading_deg": round(record.gimbal_yaw_deg, 2),
                "pitch_deg": round(record.gimbal_pitch_deg, 2),
                "distance_m": record.distance_m,
                "gsd_mm": record.gsd_full_mm,
            },
        }
        for record in records
        if record.latitude_deg is not None and record.longitude_deg is not None
    ]
    return {"type": "FeatureCollection", "features": features}
