"""The live stream's pictures and how they fail."""

from __future__ import annotations

from collections import deque

import numpy as np

from config.settings import Settings
from drivers.simulated.camera_model import ExposureControl, develop_grey
from drivers.simulated.light import Sky
from drivers.simulated.picture import Picture
from drivers.simulated.sinks import FrameSink
from perception.values import Bytes, CameraPose

_DELAY_S = 2.0


class LiveStream:
    """Draws frames of the live view and hands them to a sink."""

    def __init__(
        self,
        picture: Picture,
        sky: Sky,
        control: ExposureControl,
        settings: Settings,
        sink: FrameSink,
    ) -> None:
        camera = settings.simulation.camera
        self._picture, self._sky, self._control, self._sink = picture, sky, control, sink
        # The drawing grid has blocks of four pixels; odd sizes are cropped.
        self._width, self._height = camera.stream_width_px, camera.stream_height_px
        self._rng = np.random.default_rng([settings.simulation.seed, 0x11FE])
        self._waiting: deque[tuple[float, Bytes]] = deque()
        self._last: Bytes | None = None
        self.fault = "ok"
        self.count = 0

    def warm_up(self, pose: CameraPose) -> None:
        """Draw a frame for nobody, so that the first one is not late."""
        size = _up4(self._width), _up4(self._height)
        drawn = self._picture.draw(pose, self._sky.at(0.0), *size)
        develop_grey(drawn.radiance, self._control.exposure(0.0), 0)

    def show(self, t_s: float, pose: CameraPose) -> None:
        """Draw the frame exposed at a mission time, spoil it as the fault wants, hand it on."""
        drawn = self._picture.draw(pose, self._sky.at(t_s), _up4(self._width), _up4(self._height))
        radiance = drawn.radiance[: self._height, : self._width]
        exposure = self._control.exposure(t_s)
        self._control.meter(t_s, radiance)
        self.count += 1
        grey = develop_grey(np.ascontiguousarray(radiance), exposure, self.count)
        self._deliver(t_s, grey)

    def _deliver(self, t_s: float, grey: Bytes) -> None:
        word, sink = self.fault, self._sink
        if word == "stuck" and self._last is not None:
            sink.send(t_s, self._last)
            return
        self._last = grey
        if word == "ok":
            self._waiting.clear()
            sink.send(t_s, grey)
        elif word == "garbage":
            sink.send(t_s, self._rng.integers(0, 256, grey.shape, dtype=np.uint8))
        elif word == "wrong":
            sink.send(t_s, np.full_like(grey, 255 if self.count // 20 % 2 else 0))
        elif (word == "slow" and self.count % 8 == 0) or (
            word == "intermittent" and t_s % 4.0 < 1.5
        ):
            sink.send(t_s, grey)
        elif word == "delayed":
            self._waiting.append((t_s, grey))
            while self._waiting and self._waiting[0][0] <= t_s - _DELAY_S:
                sink.send(*self._waiting.popleft())


def _up4(size_px: int) -> int:
    return -(-size_px // 4) * 4
