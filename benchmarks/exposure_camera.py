"""The camera of the exposure bench: tone curve, noise, automatic, latency; none the controller's.

Radiance in units of a white sheet in full sun. EV 0 of a manual camera renders a blade of radiance
`REFERENCE` at grey 135.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np

from drivers.simulated.camera_model import tone
from perception.values import Bytes, Float, Float32

#: A white blade in half sun.
REFERENCE = 0.35
TARGET_GREY = 135.0
_TABLE = 4096
#: Electrons at full scale of a small pixel; read noise before and after the amplifier, of 3 and 8.
_FULL_WELL = 11000.0
_READ_BEFORE, _READ_AFTER = 3.0 / _FULL_WELL, 8.0 / _FULL_WELL
_TOP = 16.0
#: From a setting's arrival to the word that it was taken, where the latency allows it.
_CONFIRM_S = 0.03


class Curve(StrEnum):
    """Tone curves as cameras have them."""

    SHOULDER = "shoulder"
    """A toe, a long shoulder, a clip: the simulated camera's."""
    FILMIC = "filmic"
    GAMMA = "gamma"
    """A plain power and a hard clip, two stops above the target."""


@dataclass(frozen=True, slots=True)
class CameraKind:
    """One camera of the bench."""

    curve: Curve = Curve.SHOULDER
    manual: bool = True
    """EV is absolute; else it biases an automatic that meters the whole picture."""
    latency_s: float = 0.1
    """From the exposure of a frame to the first exposure with what that frame asked for."""
    jitter_s: float = 0.004
    step_ev: float = 1 / 3
    min_ev: float = -3.0
    max_ev: float = 3.0
    automatic_s: float = 0.5
    """Time constant of the automatic."""
    automatic_grey: float = 118.0
    """What the automatic wants the mean of the whole picture to be."""
    wander_ev: float = 0.06


class BenchCamera:
    """Exposes radiance; takes settings late."""

    def __init__(self, kind: CameraKind, seed: int) -> None:
        self.kind = kind
        self._rng = np.random.default_rng([seed, 0xCA])
        self._lut = _curve_table(kind.curve)
        self._gain = _light_at(self._lut, TARGET_GREY) / REFERENCE
        self._aim = _light_at(self._lut, kind.automatic_grey)
        self._settings: deque[tuple[float, float]] = deque([(-math.inf, 0.0)], maxlen=64)
        self._automatic_ev: float | None = None
        self._metered_s = 0.0
        self._due_ev = 0.0
        self._asked = 0.0

    def ask(self, ev: float, frame_s: float) -> tuple[float, float] | None:
        """Ask for an EV after a frame; return EV and time of the camera's word, None when as set.

        The word says nothing about when the setting will show.
        """
        kind = self.kind
        nearest = round(ev / kind.step_ev) * kind.step_ev
        snapped = min(max(nearest, kind.min_ev), kind.max_ev)
        if abs(snapped - self._asked) < 1e-6:
            return None
        self._asked = snapped
        late_s = kind.latency_s + float(self._rng.uniform(-1, 1)) * kind.jitter_s
        # Settings do not overtake each other.
        due_s = max(frame_s + late_s, self._settings[-1][0])
        self._settings.append((due_s, snapped))
        return snapped, frame_s + min(_CONFIRM_S, kind.latency_s)

    @property
    def asked_ev(self) -> float:
        """What it was last asked for."""
        return self._asked

    def ev_at(self, t_s: float) -> float:
        """Return the setting that exposes a picture."""
        for due_s, ev in reversed(self._settings):
            if due_s <= t_s:
                return ev
        return self._settings[0][1]

    def total_ev(self, t_s: float) -> float:
        """Return the exposure of a picture, the automatic's part included."""
        if self.kind.manual:
            return self.ev_at(t_s)
        wander = self.kind.wander_ev * math.sin(t_s / 1.9)
        return self.ev_at(t_s) + (self._automatic_ev or 0.0) + wander

    def ev_for(self, radiance: float) -> float:
        """Return the exposure, the automatic's part included, that renders a radiance at target."""
        return math.log2(REFERENCE / max(radiance, 1e-6))

    def expose(self, radiance: Float32, t_s: float) -> Bytes:
        """Return the (H, W) picture at a time, and let the automatic see it."""
        if not self.kind.manual:
            self._meter(radiance, t_s)
        return self.develop(radiance, self.total_ev(t_s))

    def develop(self, radiance: Float32, total_ev: float) -> Bytes:
        """Return the (H, W) picture at an exposure, with shot and read noise."""
        light = np.float32(self._gain * 2.0**total_ev) * radiance
        # The amplifier comes before the shutter, and what is read before it is amplified too.
        amplified = 2.0 ** max(0.0, min(total_ev, 3.0))
        read = (_READ_BEFORE * amplified) ** 2 + _READ_AFTER**2
        sigma = np.sqrt(np.float32(amplified / _FULL_WELL) * light + np.float32(read))
        noisy = light + sigma * self._rng.standard_normal(light.shape, dtype=np.float32)
        index = np.sqrt(np.clip(noisy, 0.0, _TOP)) * ((_TABLE - 1) / math.sqrt(_TOP))
        return np.asarray(self._lut[index.astype(np.int32)] + 0.5, np.uint8)

    def photo(self, radiance: Float32, total_ev: float) -> Bytes:
        """Return the (H, W) still at an exposure, through JPEG."""
        packed = cv2.imencode(
            ".jpg", self.develop(radiance, total_ev), (cv2.IMWRITE_JPEG_QUALITY, 90)
        )[1]
        return np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE), np.uint8)

    def _meter(self, radiance: Float32, t_s: float) -> None:
        """Move the automatic, one frame behind, towards its own idea of the whole picture."""
        mean = float(np.mean(np.minimum(radiance, 3.0))) * self._gain
        wanted = math.log2(self._aim / max(mean, 1e-6))
        if self._automatic_ev is None:
            self._automatic_ev = wanted
        else:
            share = 1.0 - math.exp(-(t_s - self._metered_s) / self.kind.automatic_s)
            self._automatic_ev += share * (self._due_ev - self._automatic_ev)
        self._due_ev, self._metered_s = wanted, t_s


def _curve_table(curve: Curve) -> Float:
    """Return greys by the square root of the light, so that shadows have entries enough."""
    light = np.linspace(0.0, math.sqrt(_TOP), _TABLE) ** 2
    if curve is Curve.SHOULDER:
        out = tone(light.astype(np.float32)).astype(np.float64)
    elif curve is Curve.FILMIC:
        out = (light * (2.51 * light + 0.03)) / (light * (2.43 * light + 0.59) + 0.14)
        out = np.clip(out, 0.0, 1.0) ** (1 / 2.2)
    else:
        out = np.clip(light, 0.0, 1.0) ** (1 / 2.2)
    return np.asarray(255.0 * out, np.float64)


def _light_at(table: Float, grey: float) -> float:
    return float(np.interp(grey, table, np.linspace(0.0, math.sqrt(_TOP), _TABLE)) ** 2)
