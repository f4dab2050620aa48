"""What a photo shows: the camera's pose, the blade in the picture, the metre and how sure it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from config.settings import Settings
from config.turbine import Turbine
from mission.flight.sides import blade_frame
from mission.records.photo_moment import BladeThen, PhotoMoment, Sighting, body_to_world
from perception.blade_in_picture import BladeStations, see
from perception.geometry import camera_looking_along
from perception.lens import Lens, lens_of
from perception.outline_match import MATCHED_SIGMA_M, match_outline
from perception.tip_in_picture import TIP_SIGMA_M, find_tip
from perception.values import Bytes, CameraPose, Float

STATION_STEP_M = 0.5
#: How far a root is off along its blade where the hub is right.
_ROOT_SIGMA_M = 0.05
#: The tip is looked for no farther than this from where it is drawn.
_MOST_REACH_M = 2.0
#: How far a blade seen by the LiDAR is off across its axis; and one that it did not see.
_TRACKED_SIGMA_M, _BENT_PER_METRE = 0.1, 0.012


@dataclass(frozen=True, slots=True, eq=False)
class PhotoView:
    """Geometry of one photo. World ENU, metres."""

    camera: CameraPose
    lens: Lens
    position_covariance: Float
    """(3, 3) of the camera relative to the rotor."""
    yaw_sigma_rad: float
    pitch_sigma_rad: float
    stations: BladeStations | None = None
    """The blade where it is before the camera; None where no blade is known."""
    metre_m: float | None = None
    """Where the optical axis meets the blade."""
    metre_sigma_m: float | None = None
    across_sigma_m: float | None = None
    """How far the blade may lie beside where it is drawn."""
    tracked: bool = False
    """The LiDAR saw the blade at that moment."""
    range_m: float | None = None
    """From the camera to the blade along the optical axis."""
    blade_length_m: float | None = None
    matched: bool = False
    """The outline was laid on the blade's edges in the picture."""
    sightings: tuple[Sighting, ...] = ()
    """What the picture says of the vehicle's wander."""


def view_of(
    moment: PhotoMoment, turbine: Turbine | None, settings: Settings, grey: Bytes
) -> PhotoView:
    """Return what a picture (H, W) shows, taken at a moment."""
    camera = camera_pose(moment, settings)
    lens = lens_of(settings.camera, grey.shape[1], grey.shape[0])
    covariance: Float = settings.positioning.noise_sigma_m**2 * np.eye(3)
    yaw = math.radians(settings.gimbal.yaw_sigma_deg)
    pitch = math.radians(settings.gimbal.pitch_sigma_deg)
    blade = moment.blade
    if blade is None or turbine is None:
        covariance = covariance + settings.positioning.wander_sigma_m**2 * np.eye(3)
        return PhotoView(camera, lens, covariance, yaw, pitch)
    metre, point = _axis_meets(camera, blade)
    across = _TRACKED_SIGMA_M if blade.track is not None else _BENT_PER_METRE * abs(metre)
    model = _stations(camera, lens, blade, turbine, metre)
    stations = None if model is None else _registered(model, camera, blade)
    match = None if stations is None else match_outline(grey, stations, camera, lens)
    if match is not None:
        stations, across = match.stations, MATCHED_SIGMA_M
    covariance = covariance + _relative_covariance(blade, across)
    if stations is not None:
        seen = see(stations, lens.matrix[:2, 2][None], camera, lens)
        if seen.hit[0]:
            metre, point = float(seen.metre_m[0]), seen.point_w[0]
    range_m = float(np.linalg.norm(point - camera.position_w))
    sigma = _metre_sigma(moment, camera, blade, range_m, covariance, (yaw, pitch), settings)
    sightings: list[Sighting] = []
    if match is not None and model is not None:
        angles = (yaw, pitch)
        sightings.append(_aside(match.stations, model, moment, camera, range_m, angles, settings))
        length = turbine.blade_length_m
        reach_m = min(max(0.5, 3 * sigma), _MOST_REACH_M)
        end = find_tip(grey, match.stations, camera, lens, length, reach_m)
        if end is not None:
            # The picture itself now tells the metre: pose and angles matter no more.
            sightings.append(_tip(end - length, blade, covariance, sigma))
            gain = sigma**2 / (sigma**2 + TIP_SIGMA_M**2)
            along = gain * (end - length)
            stations = match.stations.moved(along * blade.axis_w)
            metre, sigma = metre - along, math.sqrt(gain) * TIP_SIGMA_M
    return PhotoView(
        camera, lens, covariance, yaw, pitch, stations, metre, sigma, across,
        blade.track is not None, range_m, turbine.blade_length_m, match is not None,
        tuple(sightings),
    )  # fmt: skip


def _tip(off_m: float, blade: BladeThen, covariance: Float, metre_sigma_m: float) -> Sighting:
    """Return what the tip, seen so far off where it was drawn, says along the blade."""
    axis = blade.axis_w
    by_position = float(axis @ covariance @ axis)
    # What is not the position's own error (angles, time) is in the picture too.
    others = max(0.0, metre_sigma_m**2 - by_position)
    drift_m = float(blade.drift_w @ axis) + off_m
    return Sighting(axis, drift_m, math.sqrt(TIP_SIGMA_M**2 + others))


def _aside(
    matched: BladeStations,
    model: BladeStations,
    moment: PhotoMoment,
    camera: CameraPose,
    range_m: float,
    angles: tuple[float, float],
    settings: Settings,
) -> Sighting:
    """Return what the outline's place in the picture says across the blade."""
    forward = camera.rotation_wc[:, 2]
    axis = model.centre_w[-1] - model.centre_w[0]
    aside = np.cross(axis / np.linalg.norm(axis), forward)
    aside = aside / np.linalg.norm(aside)
    middle = len(model.metre_m) // 2
    off_m = float((matched.centre_w - model.centre_w)[middle] @ aside)
    ray = range_m * forward
    errors = (
        MATCHED_SIGMA_M,
        float(aside @ np.cross((0.0, 0.0, 1.0), ray)) * angles[0],
        float(aside @ np.cross(camera.rotation_wc[:, 0], ray)) * angles[1],
        float(aside @ moment.velocity_w) * settings.camera.time_sigma_s,
        _BENT_PER_METRE * float(model.metre_m[middle]),
        settings.positioning.noise_sigma_m,
    )
    return Sighting(aside, off_m, math.hypot(*errors))


def camera_pose(moment: PhotoMoment, settings: Settings) -> CameraPose:
    """Return where the camera was and where it looked."""
    eye = moment.position_w + body_to_world(moment, settings.camera.offset_m)
    yaw, pitch = moment.gimbal_yaw_rad, moment.gimbal_pitch_rad
    direction = (
        math.cos(pitch) * math.cos(yaw),
        math.cos(pitch) * math.sin(yaw),
        math.sin(pitch),
    )
    return CameraPose(0.0, eye, camera_looking_along(direction))


def _root_now(blade: BladeThen) -> Float:
    """Return the root (3,) in the frame that the vehicle reports in at the photo's moment."""
    return blade.root_w + (blade.drift_w @ blade.axis_w) * blade.axis_w


def _axis_meets(camera: CameraPose, blade: BladeThen) -> tuple[float, Float]:
    """Return the metre and point of the blade's axis nearest to the optical axis."""
    root = _root_now(blade)
    axis, forward = blade.axis_w, camera.rotation_wc[:, 2]
    if blade.track is not None:
        off = np.array(blade.track.foot_w) - root
        root = root + off - (off @ axis) * axis
    else:
        root = np.asarray(root + blade.drift_w - (blade.drift_w @ axis) * axis, np.float64)
    away: Float = camera.position_w - root
    lean = float(axis @ forward)
    metre = float(away @ axis - lean * (away @ forward)) / max(1 - lean**2, 1e-6)
    point: Float = root + metre * axis
    return metre, point


def _relative_covariance(blade: BladeThen, across_m: float) -> Float:
    axis = blade.axis_w
    along = float(axis @ blade.drift_covariance @ axis) + _ROOT_SIGMA_M**2
    both: Float = np.asarray(np.outer(axis, axis), np.float64)
    covariance: Float = along * both + across_m**2 * (np.eye(3) - both)
    return covariance


def _metre_sigma(
    moment: PhotoMoment,
    camera: CameraPose,
    blade: BladeThen,
    range_m: float,
    covariance: Float,
    angles: tuple[float, float],
    settings: Settings,
) -> float:
    """Return the standard deviation of the metre: position, angles, time.

    To first order the metre follows a displacement d of the blade in the camera's frame by g . d,
    g = (a - (a.f) f) / (1 - (a.f)^2): a the blade's axis, f the optical axis.
    """
    axis, forward = blade.axis_w, camera.rotation_wc[:, 2]
    lean = float(axis @ forward)
    gain = (axis - lean * forward) / max(1 - lean**2, 0.05)
    ray = range_m * forward
    by_yaw = float(gain @ np.cross((0.0, 0.0, 1.0), ray)) * angles[0]
    by_pitch = float(gain @ np.cross(camera.rotation_wc[:, 0], ray)) * angles[1]
    by_time = float(gain @ moment.velocity_w) * settings.camera.time_sigma_s
    by_position = float(gain @ covariance @ gain)
    return math.sqrt(by_position + by_yaw**2 + by_pitch**2 + by_time**2)


def _stations(
    camera: CameraPose, lens: Lens, blade: BladeThen, turbine: Turbine, metre: float
) -> BladeStations | None:
    """Return the blade's sections before the camera, put where the LiDAR saw the blade."""
    if blade.pitch_deg is None:
        return None
    frame = blade_frame("", blade.hub_w, blade.normal_w, blade.axis_w, blade.pitch_deg, turbine)
    away = float(np.linalg.norm(camera.position_w - (_root_now(blade) + metre * frame.axis_w)))
    reach = 0.75 * math.hypot(lens.width_px, lens.height_px) / lens.focal_px * away + 1.0
    low, high = max(0.0, metre - reach), min(frame.length_m, metre + reach)
    if high - low < STATION_STEP_M:
        return None
    count = math.ceil((high - low) / STATION_STEP_M) + 1
    grid: Float = np.linspace(low, high, count, dtype=np.float64)
    shape, share = turbine.blade, grid / frame.length_m
    chord, twist, thickness, bend, pitch_axis = (
        np.interp(share, shape.span, column)
        for column in (
            shape.chord_m, shape.twist_deg, shape.thickness, shape.prebend_m, shape.pitch_axis
        )
    )  # fmt: skip
    angles = math.radians(blade.pitch_deg) + np.radians(twist)
    cosine, sine = np.cos(angles)[:, None], np.sin(angles)[:, None]
    return BladeStations(
        metre_m=grid,
        centre_w=_root_now(blade)
        + grid[:, None] * frame.axis_w
        + bend[:, None] * frame.pressure(math.radians(blade.pitch_deg)),
        leading_w=cosine * frame.rotation_w + sine * frame.upwind_w,
        pressure_w=cosine * frame.upwind_w - sine * frame.rotation_w,
        chord_m=chord,
        thickness=thickness,
        pitch_axis=pitch_axis,
    )


def _registered(stations: BladeStations, camera: CameraPose, blade: BladeThen) -> BladeStations:
    """Return the sections moved across the axis to where the LiDAR saw the blade.

    The LiDAR's line runs through the middle of what it sees of the blade's width, not through the
    pitch axis: aside, middle is laid on middle; in depth, axis on axis.
    """
    axis = blade.axis_w
    track = blade.track
    if track is None:
        return stations.moved(blade.drift_w - (blade.drift_w @ axis) * axis)
    foot = np.array(track.foot_w)
    view = foot - camera.position_w
    view = view - (view @ axis) * axis
    view = view / np.linalg.norm(view)
    aside = np.cross(axis, view)
    at = float((foot - _root_now(blade)) @ axis)
    nearest = int(np.abs(stations.metre_m - at).argmin())
    skin = stations.shell()[nearest] @ aside
    off_aside = float(foot @ aside) - (float(skin.min()) + float(skin.max())) / 2
    off_deep = float((foot - stations.centre_w[nearest]) @ view)
    # Its direction is left: over so short a piece it is noise; the picture tells the rest.
    return stations.moved(off_aside * aside + off_deep * view)
