"""What a mission of the tracking bench was worth, by the true mesh, poses and motions.

Coverage is the field's own judgement (`drivers.simulated.judge`): the share of a side's true skin
seen in photos that are sharp by the true motion. Beside it stand what the flight says itself,
where the blade lies in each picture, and which metre the optical axis really met.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from benchmarks.tracking_flight import Flown
from benchmarks.tracking_outline import blade_beside, focal_px, met_by, outline_of
from benchmarks.tracking_payload import Still
from benchmarks.tracking_senses import TrueBlade, true_blades
from benchmarks.tracking_trials import Trial
from drivers.simulated.camera_model import Exposure
from drivers.simulated.judge import Skin, reachable, seen_in, skin_samples
from drivers.simulated.raycaster import Raycaster
from drivers.simulated.rotor_frame import blade_names
from drivers.simulated.still_centre import BladeOutline
from drivers.simulated.stills import StillTruth, motion_blur_px
from mission.flight.ledger import PhotoStatus
from perception.values import CameraPose, Float


@dataclass(frozen=True, slots=True)
class PhotoFigures:
    """One photo, truly."""

    blade: str
    side: str
    metre: float
    """As the photo says."""
    metre_error_m: float | None
    """Said minus true; None where the optical axis passes the blade by."""
    off_centre: float | None
    """The blade's middle from the picture's, as a share of its width."""
    blur_px: float
    blur_speed_px: float
    """The part of the vehicle's own motion."""
    distance_m: float
    again: bool
    in_rows: bool
    """Aimed beside the blade's middle on purpose: the blade is wider than the picture."""


@dataclass(frozen=True, slots=True)
class SideFigures:
    """One side of one blade."""

    blade: str
    side: str
    whole: float
    reachable: float
    """Share of the reachable skin that was seen."""
    reachable_share: float
    """Share of the skin that is reachable at all."""
    own: float
    """What the flight says of the whole side."""
    planned: float
    fine: float | None
    """Share of the covered skin at 1.0 mm/px or better; None where none is covered."""
    area_m2: float
    """Of the side's whole skin."""


@dataclass(frozen=True, slots=True)
class Judged:
    """One mission."""

    photos: tuple[PhotoFigures, ...] = field(repr=False)
    sides: tuple[SideFigures, ...]


def judge(trial: Trial, flown: Flown, caster: Raycaster) -> Judged:
    """Judge a flown mission."""
    blades = true_blades(trial)
    outlines = {name: outline_of(caster, trial, name) for name in blades}
    truths = [_truth_of(trial, still, caster) for still in flown.stills]
    photos = []
    for still, truth in zip(flown.stills, truths, strict=True):
        name = still.command.blade
        rows = still.command.photo_id in flown.in_rows
        photos.append(_photo(trial, still, truth, blades[name], outlines[name], rows))
    return Judged(tuple(photos), tuple(_sides(trial, flown, caster, truths)))


def _truth_of(trial: Trial, still: Still, caster: Raycaster) -> StillTruth:
    axis = still.rotation_wc[:, 2]
    hit = caster.cast(
        still.eye_w[None].astype(np.float32), axis[None].astype(np.float32), still.t_s
    )
    pose = CameraPose(still.t_s, still.eye_w, still.rotation_wc)
    blur = motion_blur_px(
        pose, still.velocity_w, still.camera_rate_rps, float(hit.range_m[0]), still.shutter_s,
        focal_px(trial),
    )  # fmt: skip
    exposure = Exposure(0.0, still.shutter_s, 100.0)
    return StillTruth(still.command.photo_id, still.t_s, pose, exposure, blur, 135.0, spoilt=False)


# --- sides ----------------------------------------------------------------------------------------


def _sides(
    trial: Trial, flown: Flown, caster: Raycaster, truths: list[StillTruth]
) -> list[SideFigures]:
    settings, names = trial.settings, blade_names(trial.scene.stop_angle_deg)
    passes = {(one.blade, one.side): one for one in flown.machine.report().passes}
    kept = _kept(flown)
    sharp = [
        truth
        for truth in truths
        if truth.index in kept and truth.blur_full_px <= settings.camera.max_blur_px
    ]
    figures = []
    for skin in skin_samples(caster.mesh, trial.scene):
        gsd_mm = np.full(len(skin.points_w), np.inf)
        for truth in sharp:
            if _far(skin, truth):
                continue
            rows = seen_in(skin, truth, caster, settings)
            gsd_mm[rows] = np.minimum(gsd_mm[rows], _gsd_mm(trial, skin, truth)[rows])
        seen = np.isfinite(gsd_mm)
        can = reachable(skin, caster, settings)
        own = passes.get((names[skin.blade], skin.side))
        figures.append(
            SideFigures(
                blade=names[skin.blade],
                side=skin.side,
                whole=float(seen.mean()),
                reachable=float(seen[can].mean()) if can.any() else 1.0,
                reachable_share=float(can.mean()),
                own=0.0 if own is None or own.coverage is None else own.coverage,
                planned=0.0 if own is None else own.planned_m / own.length_m,
                fine=float((gsd_mm[seen] <= 1.0).mean()) if seen.any() else None,
                area_m2=skin.area_m2,
            )
        )
    return sorted(figures, key=lambda one: (one.blade, one.side))


def _kept(flown: Flown) -> set[int]:
    """Return the photos that the flight counts."""
    books = flown.machine.ledger.sides.values()
    return {
        photo.photo_id
        for book in books
        for photo in book.photos
        if photo.status is PhotoStatus.TAKEN
    }


def _far(skin: Skin, truth: StillTruth) -> bool:
    """Say quickly that a photo cannot show anything of a side."""
    low, high = skin.points_w.min(axis=0) - 25.0, skin.points_w.max(axis=0) + 25.0
    place = truth.pose.position_w
    return bool((place < low).any() or (place > high).any())


def _gsd_mm(trial: Trial, skin: Skin, truth: StillTruth) -> Float:
    depth = (skin.points_w - truth.pose.position_w) @ truth.pose.rotation_wc[:, 2]
    return np.asarray(1000.0 * depth / focal_px(trial), np.float64)


# --- photos ---------------------------------------------------------------------------------------


def _photo(
    trial: Trial,
    still: Still,
    truth: StillTruth,
    blade: TrueBlade,
    outline: BladeOutline,
    in_rows: bool,
) -> PhotoFigures:
    camera = trial.settings.camera
    metre, point = met_by(blade, still.eye_w, still.rotation_wc[:, 2])
    beside = blade_beside(trial, still, blade, outline)
    turning = still.camera_rate_rps * still.shutter_s * focal_px(trial)
    return PhotoFigures(
        blade=still.command.blade,
        side=still.command.side,
        metre=still.command.metre,
        metre_error_m=None if beside is None else still.command.metre - metre,
        off_centre=None
        if beside is None
        else beside[0] * camera.focal_length_mm / camera.sensor_width_mm,
        blur_px=truth.blur_full_px,
        blur_speed_px=truth.blur_full_px - turning,
        distance_m=float(np.linalg.norm(point - still.eye_w)),
        again=still.command.repeated,
        in_rows=in_rows,
    )
