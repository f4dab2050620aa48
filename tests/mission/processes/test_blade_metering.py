from dataclasses import replace

import numpy as np
import pytest

from config.presets import turbines_of
from config.settings import Settings
from config.turbine import Site
from mission.flight.command import SensingMode, SensingTask
from mission.flight.observation import BladeEstimate
from mission.processes.blade_metering import BladeMetering
from perception.geometry import camera_looking_along
from perception.values import CameraPose, Frame

SETTINGS = Settings(sites=(Site(name="here", turbine="windpact-1.5"),))
TURBINES = turbines_of(SETTINGS.sites)
BLADE_OF = TURBINES["here"].blade
TASK = SensingTask(
    SensingMode.BLADE, 1, turbine="here", blade_root_w=(0.0, 0.0, 0.0),
    blade_tip_w=(33.0, 0.0, 0.0),
)  # fmt: skip
BLADE, GROUND = 150, 85
WIDTH, HEIGHT = 640, 480
PX_PER_M = (
    SETTINGS.camera.focal_length_mm / SETTINGS.camera.sensor_width_mm * WIDTH / 12.0
)  # at the blade


def frame(middle_m, stamp_s=1.0):
    """Of a blade that lies across the picture, ``middle_m`` above its middle."""
    rows = (HEIGHT / 2 - np.arange(HEIGHT)) / PX_PER_M
    inside = np.abs(rows - middle_m) < 0.7
    grey = np.where(inside[:, None], BLADE, GROUND) * np.ones((1, WIDTH))
    noisy = grey + np.random.default_rng(2).normal(0, 3, grey.shape)
    return Frame(stamp_s, 1, noisy.astype(np.uint8))


def camera(height_m):
    sight = np.array([0.0, 1.0, 0.0])
    return CameraPose(1.0, np.array([15.0, -12.0, height_m]), camera_looking_along(sight))


@pytest.mark.parametrize("drift_m", [0.0, 1.3, -2.0])
def test_where_only_the_camera_knows_the_drift_the_blade_is_metered_and_not_the_ground(drift_m):
    found = BladeMetering(SETTINGS, TURBINES).meter(frame(0.2), camera(drift_m), TASK, None)
    assert found is not None
    assert found.metered is not None
    assert found.metered.mean_grey == pytest.approx(BLADE, abs=2)


def test_where_the_lidar_sees_the_blade_it_is_metered_there_though_the_camera_is_aimed_beside():
    foot_w = np.array([15.0, 0.0, 1.0])
    found = BladeMetering(SETTINGS, TURBINES).meter(frame(1.0), camera(0.0), TASK, foot_w)
    assert found is not None
    assert found.metered is not None
    assert found.metered.mean_grey == pytest.approx(BLADE, abs=2)
    assert found.range_m == pytest.approx(12.0, abs=0.2)


def test_without_a_blade_to_look_for_nothing_is_metered():
    idle = SensingTask(SensingMode.IDLE, 0)
    assert BladeMetering(SETTINGS, TURBINES).meter(frame(0.0), camera(0.0), idle, None) is None


def test_a_shadow_along_the_blade_is_not_metered_for_all_of_it_where_the_pitch_is_known():
    """The pressure side is looked at: the chord shows, and the strip in shadow is no blade."""
    rows = (HEIGHT / 2 - np.arange(HEIGHT)) / PX_PER_M
    chord_m = float(np.interp(15.0 / 33.0, BLADE_OF.span, BLADE_OF.chord_m))
    profile = np.full(HEIGHT, 140.0)
    profile[np.abs(rows) < 0.5 * chord_m] = BLADE
    profile[(rows > -0.5 * chord_m) & (rows < 0.4 - 0.5 * chord_m)] = 95.0
    noise = np.random.default_rng(2).normal(0, 2, (HEIGHT, WIDTH))
    shown = Frame(1.0, 1, (profile[:, None] + noise).astype(np.uint8))
    # Feathered by nothing: the chord lies in the rotor plane, across the sight along north.
    measured = replace(
        TASK, blade="A", hub_w=(-2.0, 0.0, 0.0), normal_w=(0.0, 1.0, 0.0),
        blades=(BladeEstimate("A", (1.0, 0.0, 0.0), 0.0),),
    )  # fmt: skip
    greys = []
    for task in (TASK, measured):
        found = BladeMetering(SETTINGS, TURBINES).meter(shown, camera(0.0), task, None)
        assert found is not None
        assert found.metered is not None
        greys.append(found.metered.mean_grey)
    assert greys[0] < BLADE - 30
    assert greys[1] > BLADE - 15
