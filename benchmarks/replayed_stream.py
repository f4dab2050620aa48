"""A live stream of 1080p30 whose pictures were encoded beforehand.

It costs its sender next to nothing, so that what a receiver pays for it can be measured on the
same computer.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from drivers.clock import Clock
from drivers.simulated.h264 import H264Encoder
from drivers.simulated.rtsp_server import RtspServer
from perception.values import Bytes

WIDTH_PX, HEIGHT_PX, FPS = 1920, 1080, 30.0
_PICTURES = 60
#: Of changing light: the gains of four stretches of the film.
_GAINS = (1.0, 1.5, 0.9, 0.5)


class ReplayedPictures:
    """NAL units of a short film, again and again; a wanted key frame begins it anew."""

    def __init__(self, seed: int, *, changing_light: bool = False) -> None:
        """``changing_light``: it changes twice a second, whatever the exposure."""
        encoder = H264Encoder(WIDTH_PX, HEIGHT_PX, FPS)
        self.parameter_sets = encoder.parameter_sets
        self._units = [
            encoder.encode(picture, number / FPS, key_frame=number == 0)
            for number, picture in enumerate(_film(seed, _GAINS if changing_light else (1.0,)))
        ]
        self._next = 0
        self.mbit_per_s = (
            sum(len(u) for units in self._units for u in units) * 8e-6 * (FPS / _PICTURES)
        )

    def encode(self, picture: Bytes, t_s: float, *, key_frame: bool = False) -> list[bytes]:
        """Return the next picture's units, whatever was pushed."""
        del picture, t_s
        if key_frame:
            self._next = 0
        units = self._units[self._next]
        self._next = (self._next + 1) % _PICTURES
        return units


class ReplayedStream:
    """An RTSP server of the film; a context manager."""

    def __init__(self, seed: int, clock: Clock, *, changing_light: bool = False) -> None:
        """``clock``: its 30 pictures a second are of mission time."""
        self._clock = clock
        self.pictures = ReplayedPictures(seed, changing_light=changing_light)
        self._server = RtspServer(0, WIDTH_PX, HEIGHT_PX, FPS, encoder=self.pictures)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._push, name="replayed-stream", daemon=True)

    @property
    def url(self) -> str:
        """Where players find it."""
        return self._server.url

    def __enter__(self) -> Self:
        self._server.start()
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join()
        self._server.close()

    def _push(self) -> None:
        nothing = np.zeros((HEIGHT_PX, WIDTH_PX), np.uint8)
        next_s = self._clock.now_s()
        while not self._stop.wait(0.003):
            now_s = self._clock.now_s()
            if now_s >= next_s:
                self._server.push(nothing, now_s)
                next_s = max(next_s + 1 / FPS, now_s - 1 / FPS)


def _film(seed: int, gains: Sequence[float]) -> list[Bytes]:
    """Return pictures of a bright band (the blade) that drifts before a cloudy ground.

    ``gains``: of the light, one after the other.
    """
    rng = np.random.default_rng(seed)
    coarse = rng.normal(90.0, 25.0, (HEIGHT_PX // 40, WIDTH_PX // 20)).astype(np.float32)
    ground = cv2.resize(coarse, (2 * WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_CUBIC)
    skin = rng.normal(128.0, 4.0, (HEIGHT_PX, WIDTH_PX)).astype(np.float32)
    pictures = []
    for number in range(_PICTURES):
        drift = 4 * (number if number < _PICTURES // 2 else _PICTURES - number)
        picture = np.array(ground[:, drift : drift + WIDTH_PX], np.float32)
        picture[HEIGHT_PX // 2 - 160 : HEIGHT_PX // 2 + 160] = skin[: 2 * 160]
        gain = gains[number * len(gains) // _PICTURES]
        noisy = gain * picture + rng.normal(0.0, 1.5, picture.shape)
        pictures.append(np.clip(noisy, 0, 255).astype(np.uint8))
    return pictures
