"""Curves along each blade as in Shi et al. 2025: mean, spread and entropy of the blade's grey."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mission.records.mission_file import MissionFile
from mission.records.tones import Tones

WIDTH = 280.0
#: Of each band of the picture: its top and height, and the values at its bottom and top.
MEAN, SIGMA, ENTROPY = (10.0, 80.0, 0.0, 255.0), (108.0, 30.0, 0.0, 60.0), (156.0, 30.0, 0.0, 8.0)
Band = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Curve:
    """One side: polylines and dots, root at the left."""

    blade: str
    side: str
    length_m: float
    mean: str
    sigma: str
    entropy: str
    dots: tuple[tuple[float, float, bool, str], ...]
    """Of the mean: x, y, in range, words."""


def curves(mission: MissionFile, tones: Mapping[str, Tones]) -> list[Curve]:
    """Return a curve for each pass with a judged photo; ``tones`` by the photo's file."""
    low, high = mission.exposure.range
    found = []
    for one in mission.passes:
        dots, spreads, entropies = [], [], []
        for photo in sorted(mission.photo_list, key=lambda photo: photo.metre):
            mine = (photo.blade, photo.side) == (one.blade, one.side)
            if not mine or not photo.kept or photo.mean_grey is None:
                continue
            share = min(max(photo.metre / max(one.length_m, 1e-6), 0.0), 1.0)
            grey = photo.mean_grey
            within = low <= grey <= high if photo.in_range is None else photo.in_range
            x, words = WIDTH * share, f"{photo.metre:.1f} m: mean {grey:.0f}"
            shown = tones.get(photo.file)
            if shown is not None:
                words += f", σ {shown.sigma:.1f}, entropy {shown.entropy_bits:.2f} bits"
                spreads.append((x, height(shown.sigma, SIGMA)))
                entropies.append((x, height(shown.entropy_bits, ENTROPY)))
            dots.append((x, height(grey, MEAN), within, words))
        if dots:
            mean = _line([(x, y) for x, y, _, _ in dots])
            found.append(
                Curve(
                    one.blade,
                    one.side,
                    one.length_m,
                    mean,
                    _line(spreads),
                    _line(entropies),
                    tuple(dots),
                )
            )
    return found


def height(value: float, band: Band) -> float:
    """Return where a value stands in its band of the picture, from the picture's top."""
    top, high, least, most = band
    share = min(max((value - least) / (most - least), 0.0), 1.0)
    return top + high * (1 - share)


def _line(points: list[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
