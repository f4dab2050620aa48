"""The curves of mean, sigma and entropy from root to tip, as in the paper's figure: one picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from benchmarks.exposure_passes import Pass, Still
from benchmarks.exposure_play import MAX_GREY, MIN_GREY
from benchmarks.exposure_scene import Surface
from perception.values import Bytes

_WIDTH, _HEIGHT, _LEFT, _TOP, _GAP = 420, 170, 60, 54, 46
#: BGR.
_COLOURS = ((90, 90, 90), (200, 120, 20), (60, 60, 220), (40, 150, 40))
_FIGURES: tuple[tuple[str, Callable[[Still], float], float], ...] = (
    ("mean grey", lambda still: still.mean, 255.0),
    ("sigma", lambda still: still.sigma, 60.0),
    ("entropy, nats", lambda still: still.entropy_nats, 5.0),
)


def curves(passes: Sequence[Pass], methods: Sequence[str], title: str) -> Bytes:
    """Return the picture (H, W, 3) BGR: a column a surface, a row a figure, a line a method.

    ``passes``: of one light; ``methods``: drawn ones, in the order of their colours.
    """
    surfaces = tuple(Surface)
    width = _LEFT + len(surfaces) * (_WIDTH + _GAP)
    height = _TOP + len(_FIGURES) * (_HEIGHT + _GAP) + 24
    picture = np.full((height, width, 3), 255, np.uint8)
    _text(picture, title, (_LEFT, 18))
    for k, method in enumerate(methods):
        x = _LEFT + 230 * k
        cv2.line(picture, (x, 34), (x + 24, 34), _COLOURS[k], 2, cv2.LINE_AA)
        _text(picture, method, (x + 30, 38))
    for column, surface in enumerate(surfaces):
        for row, (name, figure, top) in enumerate(_FIGURES):
            corner = (_LEFT + column * (_WIDTH + _GAP), _TOP + row * (_HEIGHT + _GAP) + 10)
            _frame(picture, corner, f"{surface} surface: {name}", top)
            if row == 0:
                for grey in (MIN_GREY, MAX_GREY):
                    y = round(corner[1] + _HEIGHT * (1 - grey / top))
                    cv2.line(picture, (corner[0], y), (corner[0] + _WIDTH, y), (170, 220, 170), 1)
            for k, method in enumerate(methods):
                for one in passes:
                    if one.method == method and one.surface is surface:
                        _curve(picture, corner, one.stills, figure, top, _COLOURS[k])
    _text(picture, "metres from the root", (_LEFT, height - 8))
    return picture


def _frame(picture: Bytes, corner: tuple[int, int], name: str, top: float) -> None:
    x, y = corner
    cv2.rectangle(picture, (x, y), (x + _WIDTH, y + _HEIGHT), (200, 200, 200), 1)
    _text(picture, name, (x, y - 5))
    _text(picture, f"{top:g}", (x - 34, y + 10))
    _text(picture, "0", (x - 16, y + _HEIGHT))


def _curve(
    picture: Bytes,
    corner: tuple[int, int],
    stills: Sequence[Still],
    figure: Callable[[Still], float],
    top: float,
    colour: tuple[int, int, int],
) -> None:
    metres = [still.metre for still in stills]
    far = max(metres)
    points = [
        (
            corner[0] + _WIDTH * still.metre / far,
            corner[1] + _HEIGHT * (1 - min(figure(still) / top, 1.0)),
        )
        for still in stills
    ]
    line = np.round(np.array(points)).astype(np.int32).reshape(-1, 1, 2)
    cv2.polylines(picture, [line], False, colour, 2, cv2.LINE_AA)
    _text(picture, f"{far:.0f}", (corner[0] + _WIDTH - 18, corner[1] + _HEIGHT + 14))


def _text(picture: Bytes, text: str, place: tuple[int, int]) -> None:
    cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, (60, 60, 60), 1, cv2.LINE_AA)
