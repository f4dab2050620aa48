"""From radiance to 8 bit: exposure, its automatic, blur, tone curve, noise.

The response is the camera's own secret: a toe, a shoulder and real clipping, not a plain gamma.
EV is absolute in manual mode: at 0 a white blade in a clear high sun is rendered light grey, and
one step more is twice the light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from config.simulation import SimulatedCamera
from drivers.simulated.link import CameraSetting
from perception.values import Bytes, Float32

#: The light of EV 0: 1/2000 s at ISO 100, or any other pair of the same product.
_SHUTTER_AT_0_S = 1 / 2000
_BASE_ISO = 100.0
_HIGHEST_ISO = 800.0
_GAIN_AT_0 = 0.62
_MAX_EV = 9.0
_LUT_SIZE = 4096
_LUT_TOP = 4.0
_NOISE_SIZE = 1 << 16
#: Share of the light that shot noise takes at full scale, and the read noise, at ISO 100.
_SHOT = 0.00009
_READ = 0.0000025


@dataclass(frozen=True, slots=True)
class Exposure:
    """What one picture was exposed with."""

    ev: float
    """Relative to the camera's zero, the automatic's part included."""
    shutter_s: float
    iso: float

    @property
    def gain(self) -> float:
        """Exposure per radiance."""
        return _GAIN_AT_0 * math.pow(2.0, self.ev)


def exposure_of(ev: float, longest_s: float = _SHUTTER_AT_0_S) -> Exposure:
    """Return shutter time and ISO of an EV.

    Where ISO 100 needs longer than ``longest_s``, the amplifier comes first, up to ISO 800,
    because motion blurs a longer exposure; the shutter gives way last. Where it needs less, the
    shutter is shortened.
    """
    bounded = min(_MAX_EV, max(-_MAX_EV, ev))
    unamplified_s = _SHUTTER_AT_0_S * 2.0**bounded
    iso = min(_HIGHEST_ISO, _BASE_ISO * max(1.0, unamplified_s / longest_s))
    return Exposure(bounded, unamplified_s * _BASE_ISO / iso, iso)


class ExposureControl:
    """Settings that take effect late, and an automatic that meters the whole frame."""

    _METER_GREY = 0.40  # mean of the rendered frame, of full scale, that the automatic wants
    _TIME_CONSTANT_S = 0.45
    _WANDER_EV = 0.12  # the automatic never quite rests

    def __init__(self, camera: SimulatedCamera) -> None:
        self._latency_s = camera.latency_s
        self._settings = [CameraSetting(-math.inf, camera.exposure_mode, 0.0)]
        self._automatic_ev = 0.0
        self._metered_s = -math.inf

    def set(self, setting: CameraSetting) -> None:
        """Take a setting: in force a latency after its time."""
        self._settings.append(setting)
        del self._settings[:-64]

    def in_force(self, t_s: float) -> CameraSetting:
        """Return the setting that exposes a picture at a mission time."""
        for setting in reversed(self._settings):
            if setting.t_s + self._latency_s <= t_s:
                return setting
        return self._settings[0]

    def exposure(self, t_s: float) -> Exposure:
        """Return the exposure of a picture at a mission time."""
        setting = self.in_force(t_s)
        if setting.mode == "manual":
            return exposure_of(setting.ev, setting.longest_s)
        wander = 0.0 if setting.locked else self._WANDER_EV * math.sin(t_s / 1.9)
        return exposure_of(self._automatic_ev + wander + setting.ev, setting.longest_s)

    def meter(self, t_s: float, radiance: Float32) -> None:
        """Let the automatic see a frame: it moves towards its own idea of the whole frame."""
        setting = self.in_force(t_s)
        mean = float(np.mean(np.minimum(radiance[::8, ::8], 4.0)))
        wanted = math.log2(_inverse(self._METER_GREY) / max(1e-6, _GAIN_AT_0 * mean))
        if math.isinf(self._metered_s):
            self._automatic_ev = wanted
        elif setting.mode != "manual" and not setting.locked:
            share = 1.0 - math.exp(-(t_s - self._metered_s) / self._TIME_CONSTANT_S)
            self._automatic_ev += share * (wanted - self._automatic_ev)
        self._metered_s = t_s


def tone(exposure: Float32) -> Float32:
    """Return the response in [0, 1] to an exposure (1 is about the white point).

    A toe that crushes the shadows, a shoulder that compresses the lights, and a clip.
    """
    x = np.maximum(exposure, 0.0)
    body = 1.20 * x**0.72 / (x**0.72 + 0.42)
    toe = x / (x + 0.012)
    return np.asarray(np.minimum(1.0, body * toe), np.float32)


def _inverse(response: float) -> float:
    low, high = 0.0, _LUT_TOP
    for _ in range(40):
        middle = 0.5 * (low + high)
        if float(tone(np.array([middle], np.float32))[0]) < response:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


#: Indexed by the square root of the exposure, so that shadows have entries enough.
_LUT = (
    255.0 * tone((np.linspace(0.0, math.sqrt(_LUT_TOP), _LUT_SIZE) ** 2).astype(np.float32))
).astype(np.float32)
_GAUSS = np.random.default_rng(7).standard_normal(_NOISE_SIZE).astype(np.float32)

#: Blue, green and red of each `Part`, relative to its grey.
_TINT = np.array(
    [
        [1.01, 1.00, 0.99],
        [1.01, 1.00, 0.99],
        [1.01, 1.00, 0.99],
        [1.00, 1.00, 1.00],
        [1.00, 1.00, 1.00],
        [1.00, 1.00, 1.00],
        [0.62, 1.08, 0.96],
        [0.60, 1.12, 0.80],
        [0.80, 0.95, 1.20],
        [1.05, 1.00, 0.97],
        [1.22, 1.02, 0.84],
    ],
    np.float32,
)


def develop_grey(radiance: Float32, exposure: Exposure, seed: int) -> Bytes:
    """Return the (H, W) 8-bit grey picture of an (H, W) radiance."""
    return _develop(radiance, exposure.gain, exposure.iso / _BASE_ISO, _LUT, _GAUSS, seed)


def develop_colour(radiance: Float32, part: Bytes, exposure: Exposure, seed: int) -> Bytes:
    """Return the (H, W, 3) BGR picture: the grey one, tinted by what is seen."""
    return _tint(develop_grey(radiance, exposure, seed), part, _TINT)


def motion_blur(radiance: Float32, blur_px: float, angle_rad: float) -> Float32:
    """Return the picture smeared by a straight motion of so many pixels."""
    if blur_px < 0.15:
        return radiance
    # A line of two-tap samples: fractions of a pixel count as such.
    taps = max(3, 2 * math.ceil(blur_px) + 1)
    size = 2 * math.ceil(0.5 * blur_px + 0.5) + 1
    kernel = np.zeros((size, size), np.float32)
    for share in np.linspace(-0.5, 0.5, taps):
        x = size // 2 + share * blur_px * math.cos(angle_rad)
        y = size // 2 + share * blur_px * math.sin(angle_rad)
        i, j = math.floor(y), math.floor(x)
        for row, weight_y in ((i, 1 - (y - i)), (i + 1, y - i)):
            for column, weight_x in ((j, 1 - (x - j)), (j + 1, x - j)):
                if 0 <= row < size and 0 <= column < size:
                    kernel[row, column] += weight_x * weight_y
    blurred = cv2.filter2D(radiance, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, np.float32)


@njit(cache=True, nogil=True, fastmath=True)
def _develop(
    radiance: Float32, gain: float, amplification: float, lut: Float32, gauss: Float32, seed: int
) -> Bytes:  # pragma: no cover - compiled
    height, width = radiance.shape
    out = np.empty((height, width), np.uint8)
    scale = np.float32((_LUT_SIZE - 1) / np.sqrt(_LUT_TOP))
    shot, read = np.float32(_SHOT * amplification), np.float32(_READ * amplification**2)
    state = np.uint32(seed * 2654435761 + 12345)
    for y in range(height):
        # Each row begins elsewhere in the table: no pattern repeats where the eye could see it.
        state = state * np.uint32(1664525) + np.uint32(1013904223)
        k = np.int64(state >> np.uint32(16))
        for x in range(width):
            light = np.float32(gain) * radiance[y, x]
            k = (k + 1) & (_NOISE_SIZE - 1)
            light += np.sqrt(shot * light + read) * gauss[k]
            index = np.float32(0.0) if light <= 0.0 else np.sqrt(light) * scale
            i = min(_LUT_SIZE - 2, int(index))
            share = min(np.float32(1.0), index - i)
            value = lut[i] + share * (lut[i + 1] - lut[i])
            out[y, x] = np.uint8(min(255.0, value + 0.5))
    return out


@njit(cache=True, nogil=True, fastmath=True)
def _tint(grey: Bytes, part: Bytes, tint: Float32) -> Bytes:  # pragma: no cover - compiled
    height, width = grey.shape
    out = np.empty((height, width, 3), np.uint8)
    for y in range(height):
        for x in range(width):
            for k in range(3):
                value = grey[y, x] * tint[part[y, x], k]
                out[y, x, k] = np.uint8(min(np.float32(255.0), value))
    return out
