"""The truth of a mission, once it is over: what stood there, how near it came, what it saw.

Coverage (design, Definitions): share of a side's true skin (facing within 45 deg of the side's
view) seen in kept photos at <= 60 deg incidence, unoccluded, within the GSD limit, sharp, exposed
in range. Judged by true mesh, true camera poses and the pictures as developed. Reachable: some
point 10-20 m away and 8 m clear of everything sees it so.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from config.settings import Settings
from drivers.simulated.mesh import Mesh
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.rotor_frame import BladeFrame, RotorFrame, blade_names, rotor_frame
from drivers.simulated.scene import Scene
from drivers.simulated.still_centre import BLADES, BladeOutline, off_centre
from drivers.simulated.stills import StillTruth
from drivers.simulated.terrain import ground_heights_m
from perception.values import CameraPose, Float, Float32

Bools = NDArray[np.bool_]

SIDES = ("PS", "SS", "LE", "TE")
_SAMPLES = 500
_FACING_COS = math.cos(math.radians(45.0))
_INCIDENCE_COS = math.cos(math.radians(60.0))
_REACH_M = (10.0, 12.0, 15.0, 20.0)
_CLEAR_M = 8.0
#: A ray that ends this near before the sample has reached it: the skin is thin, the mesh faceted.
_SAME_M = 0.03
#: So near the picture's middle, as a share of its width, a blade counts as centred.
_CENTRED = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """Samples of one side of one blade, even over its area, as they lay at mission time 0."""

    blade: int
    side: str
    points_w: Float32
    normals_w: Float32
    area_m2: float
    """Of the whole side."""


def side_view_w(frame: BladeFrame, twist_rad: float, side: str) -> Float:
    """Return the unit direction (3,) from a blade's side to its viewer, at a station's twist."""
    if side in ("PS", "SS"):
        pressure = frame.pressure_w(twist_rad)
        return pressure if side == "PS" else -pressure
    leading = frame.leading_w(twist_rad)
    return leading if side == "LE" else -leading


def skin_samples(mesh: Mesh, scene: Scene) -> list[Skin]:
    """Draw the samples of the twelve sides, each by area, from the mesh's own triangles."""
    rng = np.random.default_rng(0xC0)
    corners = mesh.vertices[mesh.triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(faces, axis=1)
    normals = faces / np.maximum(2.0 * area, 1e-12)[:, None]
    blade = scene.turbine.blade
    twist = math.radians(float(np.interp(0.5, blade.span, blade.twist_deg)))
    skins: list[Skin] = []
    for index, frame in enumerate(rotor_frame(scene).blades):
        for side in SIDES:
            view = side_view_w(frame, twist, side)
            rows = np.flatnonzero((mesh.part == index) & (normals @ view >= _FACING_COS))
            whole_m2 = float(area[rows].sum())
            picked = rng.choice(rows, _SAMPLES, p=area[rows] / whole_m2)
            u, v = rng.random((2, _SAMPLES, 1))
            over = u + v > 1.0
            u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
            a, b, c = (corners[picked, k] for k in range(3))
            points = (a + u * (b - a) + v * (c - a)).astype(np.float32)
            normals_w = normals[picked].astype(np.float32)
            skins.append(Skin(index, side, points, normals_w, whole_m2))
    return skins


def seen_in(skin: Skin, still: StillTruth, caster: Raycaster, settings: Settings) -> Bools:
    """Return (N,) which samples a photo shows well enough."""
    camera = settings.camera
    moved = caster.motions(still.t_s)[0]
    points = skin.points_w @ moved.rotation.T + moved.shift
    rays = points - still.pose.position_w
    distance = np.linalg.norm(rays, axis=1)
    in_camera = rays @ still.pose.rotation_wc
    depth = np.maximum(in_camera[:, 2], 1e-6)
    half_x = 0.5 * camera.sensor_width_mm / camera.focal_length_mm
    half_y = 0.5 * camera.sensor_height_mm / camera.focal_length_mm
    cosine = -np.sum(rays * (skin.normals_w @ moved.rotation.T), axis=1) / distance
    seen: Bools = (
        (in_camera[:, 2] > 0.5)
        & (np.abs(in_camera[:, 0]) <= half_x * depth)
        & (np.abs(in_camera[:, 1]) <= half_y * depth)
        & (cosine >= _INCIDENCE_COS)
        & (distance <= _gsd_reach_m(settings))
    )
    rows = np.flatnonzero(seen)
    if len(rows):
        unit = (rays[rows] / distance[rows, None]).astype(np.float32)
        eye = np.broadcast_to(still.pose.position_w.astype(np.float32), unit.shape)
        seen[rows] = caster.cast(eye, unit, still.t_s).range_m >= distance[rows] - _SAME_M
    return seen


def reachable(skin: Skin, caster: Raycaster, settings: Settings) -> Bools:
    """Return (N,) which samples some allowed viewpoint sees well enough, at mission time 0."""
    found = np.zeros(len(skin.points_w), bool)
    reach = _gsd_reach_m(settings)
    clear_m = _CLEAR_M + settings.airframe.radius_m
    for distance in (d for d in _REACH_M if d <= reach):
        for tilt in (0.0, 0.45, 0.95):
            for turn in np.arange(0.0, 2 * math.pi, math.pi / 4):
                rows = np.flatnonzero(~found)
                if not len(rows):
                    return found
                if tilt == 0.0 and turn > 0.0:
                    continue
                ways = _tilted(skin.normals_w[rows], tilt, float(turn))
                eyes = skin.points_w[rows] + np.float32(distance) * ways
                ground = ground_heights_m(eyes[:, 0], eyes[:, 1], settings.simulation.seed)
                clear = (caster.clearance_m(eyes, 0.0) >= clear_m) & (
                    eyes[:, 2] - ground >= clear_m
                )
                rows, ways, eyes = rows[clear], ways[clear], eyes[clear]
                if len(rows):
                    free = caster.cast(eyes, -ways, 0.0).range_m >= distance - _SAME_M
                    found[rows[free]] = True
    return found


def judgement(
    scene: Scene,
    settings: Settings,
    caster: Raycaster,
    stills: dict[int, StillTruth],
    min_clearance_m: float,
    end_s: float,
    mission_dir: Path,
) -> str:
    """Return the truth of the mission as JSON.

    ``min_clearance_m``: least true distance of the body's centre to turbine and obstacles.
    """
    kept = [stills[index] for index in kept_indices(mission_dir) if index in stills]
    good = [still for still in kept if _well_taken(still, settings)]
    stop_deg = scene.stop_angle_deg + settings.simulation.truth.rotor_rate_dps * end_s
    names = blade_names(scene.stop_angle_deg)
    moved, frame = caster.motions(end_s), rotor_frame(scene)
    coverage: dict[str, dict[str, float]] = {name: {} for name in sorted(names)}
    of_reachable: dict[str, dict[str, float]] = {name: {} for name in sorted(names)}
    for skin in skin_samples(caster.mesh, scene):
        seen = np.zeros(len(skin.points_w), bool)
        for still in good:
            seen |= seen_in(skin, still, caster, settings)
        can = reachable(skin, caster, settings)
        coverage[names[skin.blade]][skin.side] = round(float(seen.mean()), 4)
        share = float(seen[can].mean()) if can.any() else 0.0
        of_reachable[names[skin.blade]][skin.side] = round(share, 4)
    out = {
        "stop_angle_deg": stop_deg % 120.0,
        "hub_m": (moved[1].rotation @ frame.hub_w).tolist(),
        "normal": (moved[1].rotation @ frame.normal_w).tolist(),
        "nacelle_yaw_deg": (
            scene.nacelle_yaw_deg + settings.simulation.truth.yaw_rate_dps * end_s
        ) % 360.0,
        "tilt_deg": scene.tilt_deg,
        "cone_deg": scene.cone_deg,
        "pitch_deg": {names[k]: scene.pitch_deg[k] for k in range(3)},
        "blade_directions": _directions(frame, names),
        "launch_m": list(scene.launch_w),
        "wind_mps": scene.wind_mean_mps,
        "wind_from_deg": scene.wind_from_deg,
        "min_clearance_m": min_clearance_m - settings.airframe.radius_m,
        "coverage": coverage,
        "coverage_reachable": of_reachable,
        "stills": len(stills),
        "stills_kept": len(kept),
        "still_metres": {
            str(still.index): found
            for still in kept
            if (found := centre_metre(still, caster, names)) is not None
        },
        "stills_centred": centred_share(kept, caster, frame, settings),
        "stills_out_of_range": sum(not _in_range(still, settings) for still in kept),
        "stills_blurred": sum(
            still.blur_full_px > settings.camera.max_blur_px for still in kept
        ),
    }  # fmt: skip
    return json.dumps(out)


def centred_share(
    stills: Sequence[StillTruth], caster: Raycaster, frame: RotorFrame, settings: Settings
) -> float | None:
    """Return in what share of photos the blade is in the middle; None: of none that can be told."""
    outlines = [BladeOutline(caster.mesh, part) for part in BLADES]
    found = []
    for still in stills:
        moved = caster.motions(still.t_s)[0]
        # The camera as it stood to the rotor where that lay at mission time 0.
        back = np.asarray(moved.rotation, np.float64).T
        eye = back @ (still.pose.position_w - np.asarray(moved.shift, np.float64))
        pose = CameraPose(still.t_s, eye, back @ still.pose.rotation_wc)
        axes = [blade.axis_w for blade in frame.blades]
        found.append(off_centre(outlines, axes, pose, settings.camera))
    told = [off for off in found if off is not None]
    return round(sum(abs(off) <= _CENTRED for off in told) / len(told), 4) if told else None


def centre_metre(
    still: StillTruth, caster: Raycaster, names: Sequence[str]
) -> tuple[str, float] | None:
    """Return the blade and metre (design, Definitions) that the optical axis of a photo meets.

    None where it meets no blade.
    """
    mesh = caster.mesh
    eye = still.pose.position_w.astype(np.float32)[None]
    axis = still.pose.rotation_wc[:, 2].astype(np.float32)[None]
    hit = caster.cast(eye, axis, still.t_s)
    triangle = int(hit.triangle[0])
    if triangle < 0 or int(mesh.part[triangle]) >= len(names):
        return None
    u, v = (float(share) for share in hit.uv[0])
    a, b, c = (float(mesh.metre[corner]) for corner in mesh.triangles[triangle])
    return names[int(mesh.part[triangle])], round((1 - u - v) * a + u * b + v * c, 3)


def kept_indices(mission_dir: Path) -> Sequence[int]:
    """Return the still indices of the photos that the mission kept, from their sidecars."""
    indices: list[int] = []
    for path in sorted((mission_dir / "photos").glob("**/*.json")):
        try:
            record = json.loads(path.read_text("utf-8"))
        except (OSError, ValueError):
            continue  # half written when the mission ended: not kept
        if isinstance(record, dict) and record.get("kept") is True:
            index = record.get("still_index")
            if isinstance(index, int):
                indices.append(index)
    return indices


def _directions(frame: RotorFrame, names: Sequence[str]) -> dict[str, list[float]]:
    return {name: blade.axis_w.tolist() for name, blade in zip(names, frame.blades, strict=True)}


def _in_range(still: StillTruth, settings: Settings) -> bool:
    low, high = settings.exposure.min_grey, settings.exposure.max_grey
    return still.blade_grey is not None and low <= still.blade_grey <= high


def _well_taken(still: StillTruth, settings: Settings) -> bool:
    sharp = still.blur_full_px <= settings.camera.max_blur_px
    return sharp and not still.spoilt and _in_range(still, settings)


def _gsd_reach_m(settings: Settings) -> float:
    """Return the distance at which a pixel of the camera's full size meets the GSD limit."""
    camera = settings.camera
    pixel_mm = camera.sensor_width_mm / camera.width_px
    return settings.tracking.max_gsd_mm * camera.focal_length_mm / pixel_mm / 1000.0


def _tilted(normals: Float32, tilt_rad: float, turn_rad: float) -> Float32:
    """Return (N, 3) unit directions at an angle from (N, 3) normals, turned about them."""
    helper = np.where(np.abs(normals[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(normals, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    aside = math.cos(turn_rad) * first + math.sin(turn_rad) * second
    return np.asarray(math.cos(tilt_rad) * normals + math.sin(tilt_rad) * aside, np.float32)
