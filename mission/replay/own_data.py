"""What the workers of a mission say of a recording that is not a mission's: a MID-360 and poses.

The same tracking and estimation worker as in flight, scan by scan: how near the nearest thing was,
and each second what the rotor estimate would have been at that moment. Where rotor and tower are
is not told by a machine here, so the whole recording is asked first, as `bladescout estimate` does.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter

from config.settings import Settings
from config.turbine import Site
from drivers.bus import Key
from mission.flight.command import SensingMode, SensingTask
from mission.flight.observation import (
    ClearanceState,
    FlightMode,
    RotorEstimate,
    Vec3,
    Vehicle,
)
from mission.records.recorded_cloud import SensorPoints, load_cloud, load_sensor_points, scans_of
from mission.remote.messages import VehicleMessage
from mission.replay.fed_worker import FedWorker
from mission.replay.recorded import Recorded
from perception.cloud_estimate import CloudAnswer, Question, estimate_cloud
from perception.rotor import Refusal
from perception.values import Float, Pose, Scan

RECORDINGS = (".lvx2", ".pcap", ".pcapng")
"""Endings of files that hold what a sensor saw, in its own frame."""

SCAN_S = 0.1
_SITE = "own"
_CLEARANCE = TypeAdapter(ClearanceState)
_ROTOR = TypeAdapter(RotorEstimate)
_TASK = TypeAdapter(SensingTask)


@dataclass(frozen=True, slots=True)
class OwnData:
    """A recording, where the sensor was, and what is known of the turbine."""

    cloud: Path
    poses: Path
    time_offset_s: float | None = None
    turbine: str | None = None
    """A type of config/turbines."""
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class OwnReplay:
    """What came of it."""

    scans: int
    points: int
    length_s: float
    took_s: float
    """CPU time of the workers."""
    whole: CloudAnswer
    """The rotor by the whole recording."""
    clearances: tuple[ClearanceState, ...]
    """Of each scan."""
    rotors: tuple[RotorEstimate, ...]
    """Each second's; empty where the whole recording was refused."""
    notes: tuple[str, ...]

    @property
    def nearest(self) -> ClearanceState | None:
        """The scan in which something was nearest."""
        seen = [one for one in self.clearances if one.nearest_m is not None]
        return min(seen, key=lambda one: one.nearest_m or 0.0, default=None)

    @property
    def speed(self) -> float:
        """Recorded seconds per second of computing."""
        return self.length_s / self.took_s if self.took_s > 0 else 0.0


def replay_own_data(data: OwnData, settings: Settings, question: Question) -> OwnReplay:
    """Feed a recording to the workers.

    ``question``: what is known of the rotor. Raises `BadFile` or `UnusableCloud`.
    """
    placed = load_cloud(
        data.cloud, settings.lidar, poses_path=data.poses, time_offset_s=data.time_offset_s
    )
    whole = estimate_cloud(placed.cloud, question, settings)
    found = load_sensor_points(data.cloud, data.poses, settings.lidar, data.time_offset_s)
    begun_s = time.process_time()
    workers = _workers(data, settings, found, whole)
    scans = points = 0
    for scan, known in _with_poses(found):
        scans, points = scans + 1, points + len(scan.points_l)
        for worker in workers:
            for message in known:
                worker.hear(message)
            worker.catch_up()
            worker.take_scan(scan)
    said = [item for worker in workers for item in worker.bus.published]
    return OwnReplay(
        scans,
        points,
        float(found.time_s[-1] - found.time_s[0]) if len(found.time_s) else 0.0,
        time.process_time() - begun_s,
        whole,
        tuple(_CLEARANCE.validate_json(payload) for key, payload in said if key == Key.CLEARANCE),
        tuple(_ROTOR.validate_json(payload) for key, payload in said if key == Key.ROTOR),
        found.notes,
    )


def _workers(
    data: OwnData, settings: Settings, found: SensorPoints, whole: CloudAnswer
) -> list[FedWorker]:
    sites: tuple[Site, ...] = ()
    if data.turbine is not None:
        sites = (Site(name=_SITE, turbine=data.turbine, scale=data.scale),)
    told = settings.model_copy(update={"lidar": found.lidar, "sites": sites})
    workers = [FedWorker("tracking", told)]
    rotor = whole.rotor
    if not isinstance(rotor, Refusal):
        task = SensingTask(
            SensingMode.ROTOR,
            1,
            hub_w=_vec(rotor.hub_w),
            normal_w=_vec(rotor.normal_w),
            turbine=_SITE if sites else "",
        )
        workers.append(FedWorker("estimation", told))
        workers[-1].hear(Recorded(Key.TASK, _TASK.dump_json(task), 0, 0.0))
    return workers


def _with_poses(found: SensorPoints) -> Iterator[tuple[Scan, list[Recorded]]]:
    """Yield each scan with the poses that came since the last, up to one beyond the scan."""
    at = 0
    for scan in scans_of(found, SCAN_S):
        known = []
        while at < len(found.poses):
            pose = found.poses[at]
            at += 1
            known.append(_told(pose))
            if pose.stamp_s > scan.stamp_s:
                break
        yield scan, known


def _told(pose: Pose) -> Recorded:
    """Return a pose as the vehicle would have told it."""
    vehicle = Vehicle(
        stamp_s=pose.stamp_s,
        position_w=_vec(pose.position_w),
        velocity_w=_vec(pose.velocity_w),
        quaternion_wb=(
            float(pose.quaternion_wb[0]),
            float(pose.quaternion_wb[1]),
            float(pose.quaternion_wb[2]),
            float(pose.quaternion_wb[3]),
        ),
        yaw_rad=0.0,
        mode=FlightMode.OFFBOARD,
        mode_stamp_s=pose.stamp_s,
        armed=True,
        in_air=True,
        landed=False,
        heartbeat_stamp_s=pose.stamp_s,
    )
    payload = VehicleMessage(vehicle=vehicle).model_dump_json().encode()
    return Recorded(Key.VEHICLE, payload, 0, pose.stamp_s)


def _vec(values: Float) -> Vec3:
    return float(values[0]), float(values[1]), float(values[2])
