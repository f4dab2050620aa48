"""The preflight list: what must be true before anything moves, and what mends it."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Collection, Mapping
from pathlib import Path

from config.settings import Settings
from config.turbine import Turbine
from drivers.autopilot import AutopilotLink
from drivers.autopilot_errors import AutopilotError
from drivers.autopilot_state import VehicleReading
from mission.flight.observation import PreflightItem
from mission.processes.preflight_failsafes import clock_item, failsafe_items, radio_item
from mission.remote.messages import SensingHealth

log = logging.getLogger(__name__)

MIN_FREE_BYTES = 2 << 30
MIN_BATTERY = 0.5
MAX_EPH_M = 3.0
MARGIN_OVER_TIP_M = 20.0
WORKERS = ("tracking", "estimation")
PARAMETERS = (
    "COM_OBL_RC_ACT",
    "COM_OF_LOSS_T",
    "RTL_RETURN_ALT",
    "COM_LOW_BAT_ACT",
    "NAV_DLL_ACT",
    "NAV_RCL_ACT",
    "GF_ACTION",
)


def wanted_parameters(turbine: Turbine) -> dict[str, float]:
    """Return the parameters that must be so, or safer, and their values."""
    tip_m = turbine.hub_height_m + turbine.rotor_radius_m
    return {
        "COM_OBL_RC_ACT": 5.0,
        "COM_OF_LOSS_T": 0.5,
        "RTL_RETURN_ALT": float(round(tip_m + MARGIN_OVER_TIP_M + 1.0)),
    }


async def read_parameters(link: AutopilotLink, turbine: Turbine, *, mend: bool) -> dict[str, float]:
    """Return the autopilot's parameters, after setting those that are wrong where allowed."""
    values = await link.read_parameters(PARAMETERS)
    if not mend:
        return values
    for name, wanted in wanted_parameters(turbine).items():
        if name in values and not _acceptable(name, values[name], wanted):
            try:
                await link.set_parameter(name, wanted)
            except AutopilotError as error:
                log.warning("%s could not be set to %g: %s", name, wanted, error)
            else:
                values[name] = wanted
    return values


def _acceptable(name: str, value: float, wanted: float) -> bool:
    if name == "COM_OF_LOSS_T":
        return value <= wanted + 1e-6
    if name == "RTL_RETURN_ALT":
        return value >= wanted - 1.0
    return round(value) == round(wanted)


def preflight_items(
    settings: Settings,
    turbine: Turbine,
    vehicle: VehicleReading | None,
    parameters: Mapping[str, float],
    sensing: SensingHealth | None,
    workers_ready: Collection[str],
    mission_dir: Path,
) -> tuple[PreflightItem, ...]:
    """Return every check, passed or not."""
    strict = settings.autopilot.strict
    items = [_vehicle(vehicle), _battery(vehicle, strict), _gps(vehicle, strict)]
    items += [_home(vehicle, strict)]
    items += [radio_item(vehicle, strict=strict), clock_item()]
    items += _parameter_items(turbine, parameters, strict=strict)
    items += failsafe_items(parameters)
    lidar = sensing is not None and sensing.lidar_online
    camera = sensing is not None and sensing.camera_online
    items.append(
        PreflightItem(
            "lidar",
            lidar,
            "scans arrive" if lidar else f"no scans from {settings.lidar.lidar_ip}",
            "" if lidar else "check power and network of the LiDAR, and lidar.lidar_ip",
        )
    )
    items.append(
        PreflightItem(
            "camera",
            camera,
            "pictures arrive" if camera else f"no pictures from {settings.camera.stream_url}",
            "" if camera else "check the camera and camera.stream_url",
        )
    )
    items.append(_workers(workers_ready))
    recorder = "recorder" in workers_ready
    items.append(
        PreflightItem(
            "recorder",
            recorder,
            "records" if recorder else "the recorder is not up yet",
            "" if recorder else "wait; it takes seconds. If it stays so, see the daemon's log",
        )
    )
    items.append(_disk(mission_dir))
    return tuple(items)


def _workers(ready: Collection[str]) -> PreflightItem:
    missing = [name for name in WORKERS if name not in ready]
    if not missing:
        return PreflightItem("perception", True, "ready")
    text = f"{' and '.join(missing)} still compile their kernels (once on a new machine)"
    return PreflightItem("perception", False, text, "wait; it takes under a minute")


def _vehicle(vehicle: VehicleReading | None) -> PreflightItem:
    if vehicle is None:
        return PreflightItem("vehicle", False, "no vehicle reports", "check autopilot.url")
    text = "may be armed" if vehicle.healthy else "the autopilot refuses arming"
    mend = "" if vehicle.healthy else "see the autopilot's messages in the ground station"
    return PreflightItem("vehicle", vehicle.healthy, text, mend)


def _battery(vehicle: VehicleReading | None, strict: bool) -> PreflightItem:
    charge = None if vehicle is None else vehicle.battery
    if charge is None:
        mend = "check the power module" if strict else ""
        return PreflightItem("battery", not strict, "no battery telemetry", mend)
    passed = charge >= MIN_BATTERY
    return PreflightItem(
        "battery", passed, f"{charge:.0%} left", "" if passed else "fit a charged battery"
    )


def _gps(vehicle: VehicleReading | None, strict: bool) -> PreflightItem:
    fix = None if vehicle is None else vehicle.gps_fix
    if fix is None and not strict:
        return PreflightItem("gps", True, "no GPS report")
    eph_m = None if vehicle is None else vehicle.gps_eph_m
    passed = fix is not None and fix >= 3 and (eph_m is None or eph_m <= MAX_EPH_M)
    text = "no GPS report" if fix is None else f"fix type {fix}, accuracy {eph_m or 0:.1f} m"
    return PreflightItem("gps", passed, text, "" if passed else "wait for a 3D fix")


def _home(vehicle: VehicleReading | None, strict: bool) -> PreflightItem:
    told = vehicle is not None and vehicle.home_w is not None
    passed = told or not strict
    text = "home position is set" if told else "no home position"
    return PreflightItem("home", passed, text, "" if passed else "wait for the home position")


def _parameter_items(
    turbine: Turbine, parameters: Mapping[str, float], *, strict: bool
) -> list[PreflightItem]:
    items = []
    for name, wanted in wanted_parameters(turbine).items():
        value = parameters.get(name)
        passed = not strict if value is None else _acceptable(name, value, wanted)
        shown = "not reported" if value is None else f"{value:g}"
        mend = "" if passed else f"param set {name} {wanted:g}"
        items.append(PreflightItem(name, passed, f"{name} is {shown}", mend))
    return items


def _disk(mission_dir: Path) -> PreflightItem:
    free = shutil.disk_usage(mission_dir).free
    passed = free >= MIN_FREE_BYTES
    mend = "" if passed else f"free {MIN_FREE_BYTES >> 20} MiB below {mission_dir}"
    return PreflightItem("disk", passed, f"{free >> 20} MiB free", mend)
