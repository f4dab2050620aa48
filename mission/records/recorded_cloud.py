"""A cloud's file put into the world: by its poses, or by where its sensor is said to have stood."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from config.sensors import Lidar
from drivers.bad_file import BadFile
from drivers.clouds.cloud_file import CloudFile
from drivers.clouds.pose_file import read_poses
from drivers.clouds.read import read_cloud
from perception.deskew import points_in_world
from perception.recorded_cloud import RecordedCloud
from perception.values import Float, Pose, Scan

#: Points farther outside the poses than this are left out rather than guessed.
MARGIN_S = 0.1
#: Points between poses farther apart than this, too.
MAX_GAP_S = 1.0
#: Deskewing looks at so much at a time.
PART_S = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class PlacedCloud:
    """A cloud in the world, and what a person should know of how it got there."""

    cloud: RecordedCloud
    notes: tuple[str, ...]


def load_cloud(
    path: Path,
    lidar: Lidar,
    *,
    viewpoint_w: Float | None = None,
    poses_path: Path | None = None,
    time_offset_s: float | None = None,
) -> PlacedCloud:
    """Return a recorded cloud in the world; raise `BadFile`.

    ``viewpoint_w``: (3,) where the sensor stood, for clouds that are in the world already and do
    not say it; ``poses_path``: for clouds in the sensor's frame, mounted as ``lidar`` says;
    ``time_offset_s``: added to the cloud's times to get those of the poses.
    """
    file = read_cloud(path)
    if poses_path is not None:
        poses = read_poses(poses_path)
        return _by_poses(path, file, poses_path, poses, lidar, time_offset_s)
    if file.in_sensor_frame:
        raise BadFile(
            path,
            "holds what the sensor saw, in its own frame",
            "add --poses FILE (a line each: t_s x y z qx qy qz qw, world from body)",
        )
    viewpoint = file.viewpoint if viewpoint_w is None else viewpoint_w
    if viewpoint is None:
        raise BadFile(
            path,
            "does not say where the sensor stood",
            "add --viewpoint X,Y,Z (metres, in the cloud's frame)",
        )
    cloud = RecordedCloud(file.points, viewpoint, file.time_s, file.step_m)
    return PlacedCloud(cloud, file.notes)


@dataclass(frozen=True, slots=True, eq=False)
class SensorPoints:
    """A recording as its sensor saw it, with what puts it into the world."""

    points_l: Float
    """(N, 3) metres, of the sensor as ``lidar`` has it mounted."""
    time_s: Float
    """(N,) on the clock of the poses, rising."""
    poses: Sequence[Pose]
    lidar: Lidar
    notes: tuple[str, ...]


def load_sensor_points(
    path: Path, poses_path: Path, lidar: Lidar, time_offset_s: float | None = None
) -> SensorPoints:
    """Return the usable points of a recording in the sensor's frame; raise `BadFile`."""
    poses = read_poses(poses_path)
    return _sensor_points(path, read_cloud(path), poses_path, poses, lidar, time_offset_s)


def _sensor_points(
    path: Path,
    file: CloudFile,
    poses_path: Path,
    poses: Sequence[Pose],
    lidar: Lidar,
    time_offset_s: float | None,
) -> SensorPoints:
    points, mounted = file.points, lidar
    if file.mounting is not None:
        rotation, offset = file.mounting
        points = points @ rotation.T
        mounted = lidar.model_copy(
            update={"nose_down_deg": 0.0, "offset_m": tuple(float(v) for v in offset)}
        )
    time_s = _pose_times(path, file, poses_path, poses, time_offset_s)
    covered = _covered(time_s, poses)
    usable = np.isfinite(points).all(axis=1) & covered
    notes = list(file.notes)
    lost = 1.0 - float(covered.mean()) if len(time_s) else 0.0
    if lost > 0.005:
        notes.append(f"{poses_path}: {lost:.0%} of the points have no pose near in time; left out")
    if file.trusted is not None:
        usable &= file.trusted
    points, time_s = points[usable], time_s[usable]
    order = np.argsort(time_s, kind="stable")
    return SensorPoints(points[order], time_s[order], poses, mounted, tuple(notes))


def _by_poses(
    path: Path,
    file: CloudFile,
    poses_path: Path,
    poses: Sequence[Pose],
    lidar: Lidar,
    time_offset_s: float | None,
) -> PlacedCloud:
    found = _sensor_points(path, file, poses_path, poses, lidar, time_offset_s)
    return PlacedCloud(_deskewed(found), found.notes)


def _pose_times(
    path: Path,
    file: CloudFile,
    poses_path: Path,
    poses: Sequence[Pose],
    time_offset_s: float | None,
) -> Float:
    """Return the time (N,) of each point on the clock of the poses."""
    first_s, last_s = poses[0].stamp_s, poses[-1].stamp_s
    if len(poses) == 1:
        return np.full(len(file.points), first_s)
    if file.time_s is None:
        raise BadFile(
            path,
            "says no times, so that its points cannot be given their poses",
            "store an array time_s in an NPZ, or give a single pose",
        )
    if time_offset_s is not None:
        clocks = [file.time_s + time_offset_s]
    else:
        clocks = [file.time_s] if file.arrival_s is None else [file.time_s, file.arrival_s]
    for time_s in clocks:
        if bool(((time_s > first_s) & (time_s < last_s)).any()):
            return time_s
    spans = " or ".join(f"{t.min():.3f} to {t.max():.3f} s" for t in clocks)
    raise BadFile(
        poses_path,
        f"its poses run from {first_s:.3f} to {last_s:.3f} s, the points from {spans}",
        "bring them together with --time-offset SECONDS, added to the points' times",
    )


def _covered(time_s: Float, poses: Sequence[Pose]) -> NDArray[np.bool_]:
    """Return which times (N,) have poses about them."""
    stamps = np.array([pose.stamp_s for pose in poses])
    after = np.searchsorted(stamps, time_s)
    inside = (after > 0) & (after < len(stamps))
    right = stamps[np.clip(after, 0, len(stamps) - 1)]
    left = stamps[np.clip(after - 1, 0, len(stamps) - 1)]
    near = np.minimum(np.abs(time_s - left), np.abs(time_s - right)) <= MARGIN_S
    return np.asarray(near | (inside & (right - left <= MAX_GAP_S)), np.bool_)


def scans_of(found: SensorPoints, part_s: float) -> Iterator[Scan]:
    """Yield a recording cut into scans of so many seconds; empty ones are left out."""
    points_l, time_s = found.points_l, found.time_s
    begins = np.unique(np.floor((time_s - time_s[0]) / part_s)) if len(time_s) else []
    for begin in begins:
        low = np.searchsorted(time_s, time_s[0] + begin * part_s)
        high = np.searchsorted(time_s, time_s[0] + (begin + 1) * part_s)
        if low == high:
            continue
        end_s = float(time_s[high - 1])
        yield Scan(
            stamp_s=end_s,
            sequence=int(begin),
            points_l=points_l[low:high].astype(np.float32),
            age_s=(end_s - time_s[low:high]).astype(np.float32),
            reflectivity=np.zeros(high - low, np.uint8),
            tag=np.zeros(high - low, np.uint8),
        )


def _deskewed(found: SensorPoints) -> RecordedCloud:
    """Return the points each put where the sensor stood at its time, part by part."""
    poses = found.poses
    stamps = np.array([pose.stamp_s for pose in poses])
    empty: Float = np.zeros((0, 3))
    clouds, origins, times = [empty], [empty], [np.zeros(0)]
    for scan in scans_of(found, PART_S):
        first_s = scan.stamp_s - float(scan.age_s.max())
        low = max(0, int(np.searchsorted(stamps, first_s)) - 1)
        about = poses[low : int(np.searchsorted(stamps, scan.stamp_s)) + 2]
        world, origin = points_in_world(scan, about, found.lidar)
        clouds.append(world)
        origins.append(origin)
        times.append(np.full(len(world), scan.stamp_s))
    return RecordedCloud(np.concatenate(clouds), np.concatenate(origins), np.concatenate(times))
