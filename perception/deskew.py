"""Put every LiDAR return where the sensor stood when it was measured.

A scan is gathered over 0.1 s while the vehicle moves and turns; each point is turned into the
world with the pose of its own time (`scan.stamp_s - age_s`), in steps of a millisecond: at
60 deg/s and 70 m a step is 7 cm at the very end of the range, less than the beam is wide.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from config.sensors import Lidar
from perception.geometry import lidar_in_body
from perception.values import Float, Pose, Scan

#: Poses are carried on by their velocity at most this long, then held.
MAX_EXTRAPOLATION_S = 0.25
STEP_S = 1e-3


def points_in_world(
    scan: Scan, poses: Sequence[Pose], lidar: Lidar, *, trusted_only: bool = False
) -> tuple[Float, Float]:
    """Return a scan's points and the sensor's place at each of them, both (N, 3) world metres.

    Returns that cannot be (not finite, inside the blind range, beyond 1.5 x the range) are left
    out, so N may be less than the scan's. ``trusted_only`` also leaves out what the sensor itself
    doubts (rain, fog, glue: ``tag != 0``). Without any pose nothing can be placed: N is 0.

    ``poses``: sorted by stamp, around the scan; beyond their ends the nearest is carried on by
    its velocity for at most 0.25 s.
    """
    points_l = np.asarray(scan.points_l, np.float64)
    if not len(poses) or not len(points_l):
        return np.empty((0, 3)), np.empty((0, 3))
    with np.errstate(over="ignore", invalid="ignore"):
        range2 = np.einsum("ij,ij->i", points_l, points_l)
    usable = (range2 > max(lidar.blind_range_m, 1e-3) ** 2) & (
        range2 < (1.5 * lidar.max_range_m) ** 2
    )
    usable &= np.isfinite(scan.age_s)
    if trusted_only:
        usable &= scan.tag == 0
    if not usable.all():
        points_l = points_l[usable]
    if not len(points_l):
        return np.empty((0, 3)), np.empty((0, 3))

    age_s = np.asarray(scan.age_s, np.float64)[usable]
    step = np.minimum(np.maximum(age_s, 0.0) / STEP_S, 5000.0).astype(np.int64)
    steps, index = _distinct(step)
    times_s = np.asarray(scan.stamp_s - (steps + 0.5) * STEP_S, np.float64)
    positions, rotations = _poses_at(times_s, poses)

    mounting = lidar_in_body(lidar.nose_down_deg)
    sensor_w = positions + rotations @ np.asarray(lidar.offset_m, np.float64)
    turned = np.einsum("nij,nj->ni", (rotations @ mounting)[index], points_l)
    origins_w = sensor_w[index]
    return turned + origins_w, origins_w


def _distinct(step: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the distinct steps and, for each point, the index of its step (no sort needed)."""
    seen = np.zeros(int(step.max()) + 1, bool)
    seen[step] = True
    steps = np.flatnonzero(seen)
    where = np.zeros(len(seen), np.int64)
    where[steps] = np.arange(len(steps))
    return steps, where[step]


def _poses_at(times_s: Float, poses: Sequence[Pose]) -> tuple[Float, Float]:
    """Return positions (K, 3) and body-to-world rotations (K, 3, 3) at the given times."""
    stamps = np.array([pose.stamp_s for pose in poses])
    position = np.array([pose.position_w for pose in poses], np.float64)
    velocity = np.array([pose.velocity_w for pose in poses], np.float64)
    quaternion = np.array([pose.quaternion_wb for pose in poses], np.float64)

    right = np.searchsorted(stamps, times_s).clip(1, len(stamps)) if len(stamps) > 1 else None
    if right is None:
        left = after = np.zeros(len(times_s), np.int64)
    else:
        after = np.minimum(right, len(stamps) - 1)
        left = after - 1
    gap_s = stamps[after] - stamps[left]
    share = np.divide(times_s - stamps[left], gap_s, out=np.zeros_like(times_s), where=gap_s > 0)
    share = share.clip(0.0, 1.0)[:, None]

    beyond_s = times_s - times_s.clip(stamps[0], stamps[-1])
    beyond_s = beyond_s.clip(-MAX_EXTRAPOLATION_S, MAX_EXTRAPOLATION_S)[:, None]
    end = np.where(beyond_s > 0, velocity[-1], velocity[0])
    positions = position[left] * (1 - share) + position[after] * share + beyond_s * end

    # Normalised linear blending: poses are 20 ms apart, so slerp would differ by < 1e-5 rad.
    other = quaternion[after]
    aligned = np.where(np.sum(quaternion[left] * other, axis=1, keepdims=True) < 0, -other, other)
    return positions, _rotations(quaternion[left] * (1 - share) + aligned * share)


def _rotations(quaternions: Float) -> Float:
    """Return the (K, 3, 3) rotations of (K, 4) quaternions w x y z, normalising them."""
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rotations = np.empty((len(w), 3, 3))
    rotations[:, 0, 0] = 1 - 2 * (y * y + z * z)
    rotations[:, 0, 1] = 2 * (x * y - w * z)
    rotations[:, 0, 2] = 2 * (x * z + w * y)
    rotations[:, 1, 0] = 2 * (x * y + w * z)
    rotations[:, 1, 1] = 1 - 2 * (x * x + z * z)
    rotations[:, 1, 2] = 2 * (y * z - w * x)
    rotations[:, 2, 0] = 2 * (x * z - w * y)
    rotations[:, 2, 1] = 2 * (y * z + w * x)
    rotations[:, 2, 2] = 1 - 2 * (x * x + y * y)
    return rotations
