"""The methods on a user's own bracketed photos: a folder of the same scenes at several exposures.

Photos that follow each other are one scene as long as their exposure goes on rising or falling by
EXIF (time x ISO / aperture squared). A method is shown the photo nearest to what it asked for,
from the darkest and from the brightest on, until it rests.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import piexif

from benchmarks.exposure_methods import CHOICES, FrameSeen, Maker
from benchmarks.exposure_passes import entropy_nats
from benchmarks.exposure_play import MAX_GREY, MIN_GREY, Region
from perception.values import Bytes

ENDINGS = (".jpg", ".jpeg")
WIDTH_PX = 640
FRAMES = 24
#: The blade where no mask `<photo>.mask.png` of the scene's first photo stands beside it.
DISC = 0.15
LEAST_PHOTOS = 3


class NoBrackets(ValueError):
    """The folder holds no bracketed scene."""


@dataclass(frozen=True, slots=True, eq=False)
class Bracket:
    """One scene, its photos by rising exposure."""

    name: str
    evs: tuple[float, ...]
    """About their middle."""
    greys: tuple[Bytes, ...]
    region: Region


@dataclass(frozen=True, slots=True)
class BracketLine:
    """Where a method came to rest on one scene."""

    method: str
    scene: str
    start: str
    ev: float
    frames: int
    """Until it rested; `FRAMES` when it never did."""
    mean: float
    sigma: float
    entropy_nats: float
    in_range: bool


def brackets(folder: Path) -> list[Bracket]:
    """Return the scenes of a folder; raises `NoBrackets`."""
    scenes: list[list[tuple[float, Path]]] = []
    for file in sorted(path for path in folder.rglob("*") if path.suffix.lower() in ENDINGS):
        ev = exposure_ev(file)
        if ev is None:
            continue
        if not scenes or not _goes_on(scenes[-1], ev, file):
            scenes.append([])
        scenes[-1].append((ev, file))
    found = [_bracket(sorted(scene)) for scene in scenes if len(scene) >= LEAST_PHOTOS]
    if not found:
        raise NoBrackets(f"{folder}: no {LEAST_PHOTOS} photos of one scene with rising exposure")
    return found


def exposure_ev(file: Path) -> float | None:
    """Return log2 of a photo's exposure by its EXIF, None where that is missing."""
    try:
        exif = piexif.load(str(file))["Exif"]
        time = exif[piexif.ExifIFD.ExposureTime]
        iso = exif[piexif.ExifIFD.ISOSpeedRatings]
        number = exif.get(piexif.ExifIFD.FNumber, (1, 1))
        iso = iso[0] if isinstance(iso, tuple) else iso
        return math.log2(time[0] / time[1] * iso / (number[0] / number[1]) ** 2)
    except (KeyError, ValueError, ZeroDivisionError, TypeError, piexif.InvalidImageDataError):
        return None


def _goes_on(scene: list[tuple[float, Path]], ev: float, file: Path) -> bool:
    if scene[-1][1].parent != file.parent or any(abs(ev - known) < 0.1 for known, _ in scene):
        return False
    if len(scene) < 2:
        return True
    return (ev - scene[-1][0]) * (scene[-1][0] - scene[-2][0]) > 0


def _bracket(scene: list[tuple[float, Path]]) -> Bracket:
    greys = []
    for _, file in scene:
        grey = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        if grey is None:
            raise NoBrackets(f"{file}: not a picture")
        height = round(grey.shape[0] * WIDTH_PX / grey.shape[1])
        small = cv2.resize(grey, (WIDTH_PX, height), interpolation=cv2.INTER_AREA)
        greys.append(np.asarray(small, np.uint8))
    first = scene[0][1]
    mask = cv2.imread(str(first.with_suffix(".mask.png")), cv2.IMREAD_GRAYSCALE)
    height, width = greys[0].shape
    if mask is None:
        rows, columns = np.ogrid[:height, :width]
        blade = (rows - height / 2) ** 2 + (columns - width / 2) ** 2 < (DISC * width) ** 2
    else:
        blade = cv2.resize(mask, (width, height), interpolation=cv2.INTER_NEAREST) > 127
    evs = [ev for ev, _ in scene]
    middle = 0.5 * (evs[0] + evs[-1])
    region = Region.of(np.asarray(blade, np.bool_), 0.0)
    return Bracket(first.stem, tuple(ev - middle for ev in evs), tuple(greys), region)


def measure(scenes: list[Bracket]) -> Iterator[BracketLine]:
    """Put every scene to every method at its first settings, from both ends."""
    for scene in scenes:
        for name, choices in CHOICES.items():
            make = next(iter(choices.values()))
            for start, index in (("darkest", 0), ("brightest", len(scene.evs) - 1)):
                yield _settle(scene, name, make, start, index)


def _settle(scene: Bracket, name: str, make: Maker, start: str, index: int) -> BracketLine:
    method = make(True)
    evs = np.array(scene.evs)
    method.confirmed(float(evs[index]), -1.0)
    rested = 0
    for k in range(FRAMES):
        seen = FrameSeen(
            scene.greys[index], scene.region.fitted, scene.region.centre_px,
            float(evs[index]), 0.1 * k,
        )  # fmt: skip
        chosen = int(np.argmin(np.abs(evs - method.update(seen))))
        if chosen != index:
            method.confirmed(float(evs[chosen]), 0.1 * k + 0.01)
            index, rested = chosen, k + 1
    values = scene.greys[index][scene.region.true]
    mean = float(values.mean())
    return BracketLine(
        name, scene.name, start, float(evs[index]), rested, mean, float(values.std()),
        entropy_nats(values), MIN_GREY <= mean <= MAX_GREY,
    )  # fmt: skip
