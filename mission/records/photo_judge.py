"""Is a photo kept? Blade in view and aimed at, exposed, sharp: each against its setting."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from config.settings import Settings
from mission.records.photo_moment import PhotoMoment
from mission.records.photo_view import PhotoView
from perception.blade_in_picture import clipped, edges_px, outline_px
from perception.photo_quality import PhotoQuality, judge_photo
from perception.values import Bytes, Float

#: A pixel is at most so much of the mask's edge that the sky shines in.
_EDGE_PX = 5
#: What of the blade is judged: the middle of the picture, in radii of the paper's disc. The same as
#: is metered before: a camera aimed a little aside has its narrow disc on the blade's edge.
MIDDLE_RADII = 2.5
_OUT_OF_SIGHT = (-1e9, -1e9)
#: A blade that fills so much of the picture is wider than it: photographed in rows, each is aimed
#: beside its middle on purpose.
FILLS_SHARE = 0.5
#: A blade whose outline is found so near the picture's middle, as a share of the width, is in it.
SURELY_AIMED = 0.1


@dataclass(frozen=True, slots=True)
class Verdict:
    """What was found of a photo."""

    quality: PhotoQuality | None
    aim_error: float | None
    """Of the blade's middle from the picture's centre, as a share of the width."""
    beside_w: Float | None
    """(3,) from the optical axis to the blade's middle; None where its outline was not found."""
    blade_share: float | None
    blur_px: float | None
    """At the camera's full size."""
    fault: str
    """Why it is rejected; empty: it is kept."""


def judge(
    grey: Bytes,
    view: PhotoView,
    moment: PhotoMoment,
    foot_w: Float | None,
    shutter_s: float | None,
    settings: Settings,
) -> Verdict:
    """Judge a picture (H, W) of the blade whose foot (3,) the camera was aimed at."""
    width_px = grey.shape[1]
    foot = _foot(view, foot_w)
    mask = blade_mask(view)
    share = None if mask is None else float(np.count_nonzero(mask)) / mask.size
    exposure = settings.exposure
    inner = None
    if mask is not None:
        kernel = np.ones((_EDGE_PX, _EDGE_PX), np.uint8)
        inner = np.asarray(cv2.erode(mask, kernel), np.uint8)
    quality = judge_photo(
        grey,
        foot,
        MIDDLE_RADII * exposure.disc_radius * width_px,
        (exposure.min_grey, exposure.max_grey),
        inner,
        whole=view.matched,
    )
    beside = _beside_px(view)
    aim = _aim_error(view, beside, foot if foot_w is not None else None)
    blur = _blur_px(view, moment, shutter_s, settings)
    found = view.matched and aim is not None and aim <= SURELY_AIMED
    # A slender blade seen edge-on fills little of the picture that shows it in its middle.
    fault = _fault(quality, aim, None if found else share, blur, settings)
    return Verdict(quality, aim, _beside(view, beside), share, blur, fault)


def blade_mask(view: PhotoView) -> Bytes | None:
    """Return (H, W), 255 where the blade is; None where no blade is known."""
    if view.stations is None:
        return None
    lens = view.lens
    mask = np.zeros((lens.height_px, lens.width_px), np.uint8)
    outline = clipped(outline_px(view.stations, view.camera, lens), lens.width_px, lens.height_px)
    if len(outline) > 2:
        cv2.fillPoly(mask, [np.round(outline).astype(np.int32)], (255,))
    return mask


def _foot(view: PhotoView, foot_w: Float | None) -> tuple[float, float]:
    """Return where the blade's foot lies in the picture; its centre where that is not known."""
    if foot_w is None:
        return view.lens.width_px / 2, view.lens.height_px / 2
    in_camera = (foot_w - view.camera.position_w) @ view.camera.rotation_wc
    pixels, ahead = view.lens.pixels(in_camera[None])
    if not ahead[0]:
        return _OUT_OF_SIGHT
    return float(pixels[0, 0]), float(pixels[0, 1])


def _beside_px(view: PhotoView) -> Float | None:
    """Return how far (2,) the blade's middle lies from the picture's centre, in pixels."""
    if view.stations is None:
        return None
    one, other = edges_px(view.stations, view.camera, view.lens)
    if len(one) < 2:
        return None
    return _to_line(_centre(view), (one + other) / 2)


def _aim_error(
    view: PhotoView, beside_px: Float | None, foot: tuple[float, float] | None
) -> float | None:
    """Return how far the blade's middle is from the picture's centre, as a share of the width."""
    if beside_px is None and (foot is None or foot == _OUT_OF_SIGHT):
        return None
    off_px = np.array(foot) - _centre(view) if beside_px is None else beside_px
    return float(np.linalg.norm(off_px)) / view.lens.width_px


def _beside(view: PhotoView, beside_px: Float | None) -> Float | None:
    """Return the same in metres (3,), at the blade's range, where its edges show it."""
    if beside_px is None or view.range_m is None or not view.matched:
        return None
    off_m = beside_px * view.range_m / view.lens.focal_px
    return np.asarray(view.camera.rotation_wc[:, :2] @ off_m, np.float64)


def _centre(view: PhotoView) -> Float:
    return np.array([view.lens.width_px / 2, view.lens.height_px / 2])


def _to_line(point: Float, line: Float) -> Float:
    """Return the way (2,) from a point (2,) to the nearest one of a polyline (K, 2)."""
    start, step = line[:-1], np.diff(line, axis=0)
    share = np.einsum("kc,kc->k", point - start, step) / np.maximum((step**2).sum(axis=1), 1e-9)
    ways: Float = start + np.clip(share, 0, 1)[:, None] * step - point
    return np.asarray(ways[np.linalg.norm(ways, axis=1).argmin()], np.float64)


def _blur_px(
    view: PhotoView, moment: PhotoMoment, shutter_s: float | None, settings: Settings
) -> float | None:
    """Return how far the picture moved while the shutter was open, at the camera's full size."""
    if shutter_s is None or view.range_m is None or math.isnan(moment.turning_rps):
        return None
    forward = view.camera.rotation_wc[:, 2]
    across = moment.velocity_w - (moment.velocity_w @ forward) * forward
    turning = moment.turning_rps + float(np.linalg.norm(across)) / view.range_m
    focal_px = view.lens.focal_px * settings.camera.width_px / view.lens.width_px
    return turning * shutter_s * focal_px


def _fault(
    quality: PhotoQuality | None,
    aim: float | None,
    share: float | None,
    blur_px: float | None,
    settings: Settings,
) -> str:
    limits = settings.photos
    if quality is None or (share is not None and share < limits.min_blade_share):
        return "the blade is not in the picture"
    if quality.clipped > limits.max_clipped:
        return "the blade is overexposed beyond recovery"
    if quality.mean_grey < limits.min_mean_grey:
        return "the picture is black"
    fills = share is not None and share > FILLS_SHARE
    if aim is not None and aim > limits.max_aim_error and not fills:
        return f"aimed beside the blade, by {aim:.0%} of the picture's width"
    if blur_px is not None and blur_px > limits.max_blur_px:
        return f"blurred by motion, {blur_px:.1f} px"
    if quality.sharpness < limits.min_sharpness:
        return f"not sharp ({quality.sharpness:.1f})"
    return ""
