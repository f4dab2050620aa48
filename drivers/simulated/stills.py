"""The simulated camera's photos: drawn when the shutter opened, developed, served over HTTP."""

from __future__ import annotations

import http.server
import math
import re
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np

from config.settings import Settings
from drivers.simulated.camera_model import Exposure, ExposureControl, develop_colour, motion_blur
from drivers.simulated.light import Sky
from drivers.simulated.link import StillDone, StillRequest, TruthState
from drivers.simulated.picture import Picture
from drivers.simulated.vehicle import Vec3
from perception.values import Bytes, CameraPose

_JPEG_QUALITY = 90
_BAND_PX = 128
_LEAST_BLADE_PX = 60
#: Late answers of a camera that is `slow` or `delayed`, mission seconds.
LATE_S = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class StillTruth:
    """What is truly known of one photo; for the judgement."""

    index: int
    t_s: float
    pose: CameraPose
    exposure: Exposure
    blur_full_px: float
    """Motion blur in pixels of the camera's full size."""
    blade_grey: float | None
    """Mean grey of all pixels that show the blade photographed; None: none does."""
    spoilt: bool
    """A fault took the place of the picture."""


class StillCamera:
    """Takes photos and keeps them as files, with their truth."""

    def __init__(
        self, picture: Picture, sky: Sky, control: ExposureControl, settings: Settings, folder: Path
    ) -> None:
        self._picture, self._sky, self._control = picture, sky, control
        self._settings, self._folder = settings, folder
        scale, camera = settings.simulation.camera.still_scale, settings.camera
        self._width = max(64, round(camera.width_px * scale / 4) * 4)
        self._height = max(64, round(camera.height_px * scale / 4) * 4)
        self._url = f"http://127.0.0.1:{settings.simulation.camera.http_port}"
        self._rng = np.random.default_rng([settings.simulation.seed, 0x57])
        self._last: Bytes | None = None
        self.fault = "ok"
        self.truths: dict[int, StillTruth] = {}
        folder.mkdir(parents=True, exist_ok=True)

    def warm_up(self, pose: CameraPose) -> None:
        """Draw and develop a small photo for nobody, so that the first one is not late."""
        drawn = self._picture.draw(pose, self._sky.at(0.0), 64, 64)
        develop_colour(drawn.radiance, drawn.part, self._control.exposure(0.0), 0)

    def take(
        self, request: StillRequest, pose: CameraPose, state: TruthState
    ) -> Iterator[StillDone | None]:
        """Draw one photo in bands, yielding None between them and the answer at the end."""
        exposure, word = self._control.exposure(request.t_s), self.fault
        if word == "off" or (word == "intermittent" and self._rng.random() < 0.5):
            yield self._done(request, exposure, ok=False)
            return
        light = self._sky.at(request.t_s)
        bands = self._picture.draw_in_bands(pose, light, self._width, self._height, _BAND_PX)
        while (drawn := next(bands)) is None:
            yield None
        blur_px = motion_blur_px(
            pose, state.velocity_w, state.camera_rate_rps, drawn.centre_m, exposure.shutter_s,
            self._focal_px,
        )  # fmt: skip
        angle = float(self._rng.uniform(0.0, math.pi))
        radiance = motion_blur(drawn.radiance, blur_px, angle)
        colour = develop_colour(radiance, drawn.part, exposure, request.index + 1)
        grey = _blade_grey(colour[..., 1], drawn.part)
        if word == "stuck" and self._last is not None:
            colour = self._last
        elif word == "wrong":
            colour = np.zeros_like(colour)
        self._last = colour
        yield None
        self._write(request.index, colour, word)
        full_px = blur_px / (self._width / self._settings.camera.width_px)
        spoilt = word in ("stuck", "wrong", "garbage")
        self.truths[request.index] = StillTruth(
            request.index, request.t_s, pose, exposure, full_px, grey, spoilt
        )
        yield self._done(request, exposure, ok=True)

    def path_of(self, index: int) -> Path:
        """Return where a photo's file is."""
        return self._folder / f"{index}.jpg"

    @property
    def _focal_px(self) -> float:
        camera = self._settings.camera
        return camera.focal_length_mm / camera.sensor_width_mm * self._width

    def _write(self, index: int, colour: Bytes, word: str) -> None:
        ok, encoded = cv2.imencode(".jpg", colour, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
        if not ok:
            raise OSError(f"photo {index} could not be encoded")
        data = bytearray(encoded.tobytes())
        if word == "garbage":
            data[200::3] = bytes(len(data[200::3]))
        self.path_of(index).write_bytes(data)

    def _done(self, request: StillRequest, exposure: Exposure, *, ok: bool) -> StillDone:
        return StillDone(
            index=request.index,
            t_s=request.t_s,
            url=f"{self._url}/{request.index}.jpg" if ok else "",
            ok=ok,
            ev=exposure.ev,
            shutter_s=exposure.shutter_s,
            iso=exposure.iso,
        )


def motion_blur_px(
    pose: CameraPose,
    velocity_w: Vec3,
    camera_rate_rps: float,
    range_m: float,
    shutter_s: float,
    focal_px: float,
) -> float:
    """Return how far the picture's centre moves while the shutter is open.

    ``range_m``: of what is seen there, inf for the sky. Moving and turning are added as if they
    went the same way: the worst case.
    """
    axis = pose.rotation_wc[:, 2]
    velocity = np.asarray(velocity_w)
    across = float(np.linalg.norm(velocity - (velocity @ axis) * axis))
    turning = camera_rate_rps + (across / range_m if math.isfinite(range_m) else 0.0)
    return turning * shutter_s * focal_px


def _blade_grey(grey: Bytes, part: Bytes) -> float | None:
    """Return the mean grey of the blade of which most is seen; another may stand behind it."""
    shown = np.bincount(part.ravel(), minlength=3)[:3]
    blade = int(shown.argmax())
    return float(grey[part == blade].mean()) if shown[blade] >= _LEAST_BLADE_PX else None


class StillServer:
    """Serves the folder's photos as `/<index>.jpg` on loopback."""

    def __init__(self, folder: Path, port: int) -> None:
        handler = type("_Handler", (_Handler,), {"folder": folder})
        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", port), handler)
        self._server.daemon_threads = True
        self.port = int(self._server.server_address[1])
        threading.Thread(target=self._server.serve_forever, name="stills-http", daemon=True).start()

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()


class _Handler(http.server.BaseHTTPRequestHandler):
    folder: ClassVar[Path]

    def do_GET(self) -> None:
        match = re.fullmatch(r"/(\d{1,8})\.jpg", self.path)
        path = None if match is None else self.folder / f"{match[1]}.jpg"
        if path is None or not path.is_file():
            self.send_error(404)
            return
        data = path.read_bytes()
        self.send_response(200)
        self.send_header("Content-Type", "image/jpeg")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
        """Keep quiet: the world's own log tells of photos."""
