"""One method before one camera, frame by frame."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.exposure_camera import BenchCamera
from benchmarks.exposure_methods import FrameSeen, Method
from perception.values import Bytes, Float32

MIN_GREY, MAX_GREY = 110.0, 160.0
#: Width of the metered strip, of the blade's true width.
SURE_WIDTH = 0.7
#: By how much (of the picture's height) the fitted blade lies beside the true one.
ASIDE = 0.015


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """The blade in a picture: as it is, and as the fit has it."""

    true: NDArray[np.bool_]
    fitted: NDArray[np.bool_]
    centre_px: tuple[float, float]

    @classmethod
    def of(cls, blade: NDArray[np.bool_], aside: float) -> Region:
        """Return the region of a mask (H, W); ``aside``: -1 to 1 of `ASIDE`."""
        shifted = np.roll(blade, round(aside * ASIDE * blade.shape[0]), axis=0)
        width_px = float(blade.sum(axis=0).mean())
        size = max(1, 2 * int(0.25 * (1.0 - SURE_WIDTH) * 2 * width_px) + 1)
        kernel = np.ones((size, 1), np.uint8)
        fitted = cv2.erode(shifted.astype(np.uint8), kernel, borderValue=1).astype(bool)
        if fitted.sum() < 20:
            fitted = shifted
        middle = fitted[:, fitted.shape[1] // 2]
        rows = np.flatnonzero(middle if middle.any() else fitted.any(axis=1))
        return cls(blade, fitted, (fitted.shape[1] / 2, float(rows.mean())))


@dataclass(slots=True)
class Record:
    """What came of it, a value a frame."""

    greys: list[float] = field(default_factory=list)
    """True mean of the blade."""
    evs: list[float] = field(default_factory=list)
    """In force, the automatic's part left out."""
    asked: list[float] = field(default_factory=list)
    """What the camera was asked for after the frame."""
    clipped: list[float] = field(default_factory=list)
    reachable: list[bool] = field(default_factory=list)
    """Whether the camera had an EV that would have put the blade in range."""

    def delays(self, first: int) -> list[int]:
        """Return how many frames each setting took to show that was asked for from a frame on."""
        changed = (
            k for k in range(max(first, 1), len(self.asked)) if self.asked[k] != self.asked[k - 1]
        )
        return [
            self.evs.index(self.asked[k], k + 1) - k
            for k in changed
            if self.asked[k] in self.evs[k + 1 :]
        ]

    def outside(self) -> NDArray[np.bool_]:
        """Return which frames are out of range though the camera could have been right."""
        greys = np.array(self.greys)
        outside = (greys < MIN_GREY) | (greys > MAX_GREY)
        return np.asarray(outside & np.array(self.reachable, bool), np.bool_)


class Player:
    """A method and its camera."""

    def __init__(self, method: Method, camera: BenchCamera) -> None:
        self.method, self.camera = method, camera
        self.record = Record()
        self._words: deque[tuple[float, float]] = deque([(0.0, -1.0)])

    def frame(self, radiance: Float32, region: Region, t_s: float, *, spare: bool = False) -> Bytes:
        """Expose a frame, show it to the method, ask the camera for what it wants.

        ``spare``: no photo is near, as every method is told.
        """
        camera = self.camera
        grey = camera.expose(radiance, t_s)
        # Word of the settings arrives a little after it was given, as over a bus.
        while self._words and self._words[0][1] <= t_s + 0.03:
            self.method.confirmed(*self._words.popleft())
        seen = FrameSeen(grey, region.fitted, region.centre_px, camera.ev_at(t_s), t_s, spare)
        word = camera.ask(self.method.update(seen), t_s)
        if word is not None:
            self._words.append(word)
        self._note(grey, radiance, region, t_s)
        return grey

    def _note(self, grey: Bytes, radiance: Float32, region: Region, t_s: float) -> None:
        values = grey[region.true]
        record, camera = self.record, self.camera
        record.greys.append(float(values.mean()))
        record.clipped.append(float((values >= 253).mean()))
        record.evs.append(camera.ev_at(t_s))
        record.asked.append(camera.asked_ev)
        light = float(np.exp(np.log(np.maximum(radiance[region.true], 1e-5)).mean()))
        needed = camera.ev_for(light) - camera.total_ev(t_s) + camera.ev_at(t_s)
        kind = camera.kind
        record.reachable.append(kind.min_ev - 0.4 <= needed <= kind.max_ev + 0.4)
