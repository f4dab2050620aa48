"""The MID-360 of the tracking bench: its own pattern through the true mesh, thinly cast.

One ray in three is cast near the blade that is flown and towards the rest of the turbine, one in
twenty-four elsewhere: fewer returns than the field has, and enough for the blade's line, for the
turbine's place and for clearance. Noise and grazing losses
follow `drivers.simulated.mid360_noise`; the points are put in the world by what the autopilot
believes of itself, as on the wire. A scan is taken at one moment (the vehicle moves 0.2 m in it at
most, and the deskewing of the wire undoes that).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from config.sensors import Lidar
from drivers.simulated.mid360_pattern import rays
from drivers.simulated.raycaster import Raycaster
from perception.geometry import lidar_in_body
from perception.values import Float, Float32

SCAN_S = 0.1
_RAYS = 20_000
_SCANS = 40
#: Of all rays, and of those that are left, away from the blade.
_THIN = 3
_THINNER = 8
#: Half the window about the blade: of its length in view, and across it.
_ALONG_COS = 0.80
_ACROSS_SIN = 0.20
#: Beside the other blades and the tower's axis: so far, or so much of their distance.
_BESIDE_M, _BESIDE_SIN = 4.0, 0.03
#: Flatter than this over the surface, echoes are lost more and more.
_GRAZING_RAD = float(np.deg2rad(12.0))
_ANGLE_SIGMA_RAD = float(np.deg2rad(0.08))


@dataclass(frozen=True, slots=True, eq=False)
class BodyPose:
    """A body's place and attitude: position (3,) and rotation (3, 3) of FLU into the world."""

    position: Float
    rotation: Float


@lru_cache(maxsize=1)
def _pattern() -> Float32:
    """Return (scans, rays, 3): four seconds of the sensor's pattern, thinned, sensor frame."""
    return np.stack([rays(SCAN_S * k, _RAYS)[0][k % _THIN :: _THIN][:6666] for k in range(_SCANS)])


class ThinLidar:
    """Scans of the true world, told in the frame that the autopilot believes."""

    def __init__(self, caster: Raycaster, lidar: Lidar, seed: int) -> None:
        self._caster = caster
        self._mounting = lidar_in_body(lidar.nose_down_deg)
        self._offset_b = np.asarray(lidar.offset_m)
        self._max_m = lidar.max_range_m
        self._rng = np.random.default_rng([seed, 0x11D])
        self._count = 0

    def scan(
        self,
        true: BodyPose,
        believed: BodyPose,
        blade_w: tuple[Float, Float] | None = None,
        others_w: tuple[tuple[Float, Float], ...] = (),
    ) -> Float:
        """Return the returns (N, 3) of one scan, in the frame of the believed pose.

        ``blade_w``: the blade that is flown, as a point of it beside the vehicle and its unit
        direction, in the true world. ``others_w``: ends of what else is looked at as closely.
        """
        pattern = _pattern()[self._count % _SCANS]
        first = self._count % _THINNER
        self._count += 1
        eye = true.position + true.rotation @ self._offset_b
        turn = true.rotation @ self._mounting
        chosen = np.zeros(len(pattern), bool)
        chosen[first::_THINNER] = True
        if blade_w is not None:
            chosen |= _towards(pattern, turn, eye, *blade_w)
        for end_w, other_w in others_w:
            chosen |= _along(pattern, turn, end_w - eye, other_w - eye)
        directions_l = pattern[chosen]
        directions_w = (directions_l @ turn.T).astype(np.float32)
        origins = np.broadcast_to(eye.astype(np.float32), directions_w.shape)
        hits = self._caster.cast(origins, directions_w, 0.0)
        rows = np.flatnonzero(hits.range_m < self._max_m)
        cosine = np.abs(np.einsum("ij,ij->i", hits.normal_w[rows], directions_w[rows]))
        grazing = np.pi / 2 - np.arccos(np.minimum(cosine, 1.0))
        returned = self._rng.random(len(rows)) < grazing / _GRAZING_RAD
        rows, cosine = rows[returned], np.maximum(cosine[returned], 0.02)
        range_m = hits.range_m[rows].astype(np.float64)
        noise = self._rng.standard_normal((4, len(rows)))
        range_m += np.hypot(0.0034, 0.00073 * range_m) / cosine**0.78 * noise[3]
        reported = directions_l[rows] + _ANGLE_SIGMA_RAD * noise[:3].T
        points_b = (reported * range_m[:, None]) @ self._mounting.T + self._offset_b
        return np.asarray(believed.position + points_b @ believed.rotation.T, np.float64)


def _towards(
    pattern: Float32, turn: Float, eye: Float, point: Float, direction: Float
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return which rays of a scan go near the blade."""
    towards = point - eye
    towards = towards - (towards @ direction) * direction
    size = float(np.linalg.norm(towards))
    if size < 1.0:
        return np.zeros(len(pattern), bool)
    towards = towards / size
    across = np.cross(direction, towards)
    axes = (turn.T @ np.stack([towards, across], axis=1)).astype(np.float32)
    seen = pattern @ axes
    near: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] = (seen[:, 0] > _ALONG_COS) & (
        np.abs(seen[:, 1]) < _ACROSS_SIN
    )
    return near


def _along(
    pattern: Float32, turn: Float, end: Float, other: Float
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return which rays of a scan pass near a line between two ends, seen from the sensor."""
    across = np.cross(end, other)
    size, apart = float(np.linalg.norm(across)), float(np.linalg.norm(other - end))
    if size < 1e-6:
        return np.zeros(len(pattern), bool)
    across = across / size
    near_m = max(size / apart, 1.0)
    # Square to the plane of sensor and line; and inside the wedge that the line spans.
    sides = np.stack([across, np.cross(across, end), np.cross(other, across)], axis=1)
    seen = pattern @ (turn.T @ sides).astype(np.float32)
    spare = max(_BESIDE_M / near_m, _BESIDE_SIN)
    found: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] = (
        (np.abs(seen[:, 0]) < min(spare, _ACROSS_SIN)) & (seen[:, 1] > 0) & (seen[:, 2] > 0)
    )
    return found
