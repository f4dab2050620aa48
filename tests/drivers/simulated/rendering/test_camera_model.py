from __future__ import annotations

import math

import numpy as np
import pytest

from config.simulation import SimulatedCamera
from drivers.simulated.camera_model import (
    ExposureControl,
    develop_colour,
    develop_grey,
    exposure_of,
    motion_blur,
    tone,
)
from drivers.simulated.link import CameraSetting

FLAT = np.full((48, 64), 0.3, np.float32)


def test_the_response_rises_clips_and_is_not_a_plain_gamma() -> None:
    x = np.linspace(0.0, 4.0, 400, dtype=np.float32)
    y = tone(x)
    assert np.all(np.diff(y) >= 0.0)
    assert y[0] == 0.0
    assert y[-1] == 1.0
    slopes = np.diff(np.log(tone(np.array([0.02, 0.04, 0.3, 0.6], np.float32)))) / math.log(2)
    assert slopes[0] > 1.5 * slopes[2]


def test_a_step_of_ev_brightens_and_both_ends_saturate() -> None:
    greys = [develop_grey(FLAT, exposure_of(ev), 1).mean() for ev in (-9, -2, -1, 0, 1, 2, 9)]
    assert greys == sorted(greys)
    assert greys[0] < 5
    assert greys[-1] == 255
    assert 80 < greys[3] < 180


def test_amplifying_is_noisier_than_opening_but_keeps_the_shutter_short() -> None:
    assert exposure_of(0.0).shutter_s == pytest.approx(1 / 2000)
    assert exposure_of(-2.0).shutter_s == pytest.approx(1 / 8000)
    assert exposure_of(2.0).shutter_s == pytest.approx(1 / 2000)
    assert exposure_of(2.0).iso == pytest.approx(400.0)
    assert exposure_of(5.0).shutter_s > 1 / 2000
    quick = exposure_of(0.0, 1 / 4000)
    assert (quick.shutter_s, quick.iso) == (pytest.approx(1 / 4000), pytest.approx(200.0))
    assert quick.gain == exposure_of(0.0).gain
    assert exposure_of(-2.0, 1 / 4000).iso == pytest.approx(100.0)
    assert exposure_of(3.0, 1 / 4000).shutter_s == pytest.approx(1 / 2000)
    clean = develop_grey(FLAT, exposure_of(0.0), 1).std()
    noisy = develop_grey(FLAT / 8, exposure_of(3.0), 1).std()
    assert 0.3 < clean < 4.0
    assert noisy > 1.5 * clean


def test_a_setting_takes_effect_a_latency_later() -> None:
    control = ExposureControl(SimulatedCamera(latency_s=0.2))
    control.set(CameraSetting(1.0, "manual", 2.0))
    assert control.exposure(1.1).ev == 0.0
    assert control.exposure(1.21).ev == 2.0


def test_the_automatic_meters_the_whole_frame_and_never_quite_rests() -> None:
    control = ExposureControl(SimulatedCamera(exposure_mode="compensation", latency_s=0.0))
    for k in range(60):
        control.meter(0.1 * k, np.full((64, 64), 0.05, np.float32))
    dark = control.exposure(6.0).ev
    control.set(CameraSetting(6.0, "compensation", 1.0))
    assert control.exposure(6.0).ev == pytest.approx(dark + 1.0)
    for k in range(60, 120):
        control.meter(0.1 * k, np.full((64, 64), 0.8, np.float32))
    assert control.exposure(12.0).ev < dark - 1.5
    evs = {round(control.exposure(12.0 + 0.5 * k).ev, 3) for k in range(10)}
    assert len(evs) > 3


def test_the_lock_stops_the_automatic() -> None:
    control = ExposureControl(SimulatedCamera(exposure_mode="compensation", latency_s=0.0))
    control.meter(0.0, np.full((64, 64), 0.3, np.float32))
    control.set(CameraSetting(1.0, "compensation", 0.0, locked=True))
    before = control.exposure(1.0).ev
    control.meter(5.0, np.full((64, 64), 3.0, np.float32))
    assert control.exposure(6.0).ev == before


def test_blur_smears_an_edge_by_its_length_and_keeps_the_light() -> None:
    edge = np.zeros((40, 80), np.float32)
    edge[:, 40:] = 1.0
    assert motion_blur(edge, 0.05, 0.0) is edge
    blurred = motion_blur(edge, 6.0, 0.0)
    row = blurred[20]
    assert np.sum((row > 0.02) & (row < 0.98)) in range(5, 9)
    assert blurred.mean() == pytest.approx(edge.mean(), abs=0.01)


def test_colour_is_the_grey_picture_tinted_by_what_is_seen() -> None:
    part = np.zeros(FLAT.shape, np.uint8)
    part[:, 32:] = 10
    colour = develop_colour(FLAT, part, exposure_of(0.0), 1)
    grey = develop_grey(FLAT, exposure_of(0.0), 1)
    assert abs(float(colour[:, :32].mean()) - float(grey[:, :32].mean())) < 2.0
    assert colour[:, 32:, 0].mean() > colour[:, 32:, 2].mean() + 20  # sky is blue
