"""How much a photo taken now would be blurred."""

import math

import pytest

from config.settings import Settings
from mission.flight.footprint import tracking_speed_mps
from mission.flight.motion import Motion, shutter_s, sight_w
from mission.flight.observation import CameraState, FlightMode, GimbalState, Observation, Vehicle

SETTINGS = Settings()
FOCAL_PX = 20.0 / 7.6 * 5184


def observed(now_s, velocity_w=(0.0, 0.0, 0.0), yaw_rad=0.0, shutter=1 / 4000):
    vehicle = Vehicle(
        now_s, (0.0, 0.0, 50.0), velocity_w, (1.0, 0.0, 0.0, 0.0), 0.0, FlightMode.OFFBOARD,
        now_s, True, True, False, now_s,
    )  # fmt: skip
    camera = CameraState(now_s, 0.0, now_s, shutter_s=shutter)
    return Observation(
        now_s, 1, vehicle=vehicle, gimbal=GimbalState(now_s, yaw_rad, 0.0), camera=camera
    )


def test_speed_along_the_sight_does_not_blur_and_across_it_does():
    motion = Motion(SETTINGS)
    assert motion.blur_px(observed(1.0, (1.5, 0.0, 0.0)), 12.0) == pytest.approx(0.0, abs=1e-9)
    blur = motion.blur_px(observed(1.0, (0.0, 1.5, 0.0)), 12.0)
    assert blur == pytest.approx(1.5 / 12.0 / 4000 * FOCAL_PX)


def test_the_cameras_own_turning_is_added():
    motion = Motion(SETTINGS)
    for tick in range(5):
        motion.take(observed(0.05 * tick, yaw_rad=math.radians(2.0) * 0.05 * tick))
    assert motion.rate_rps == pytest.approx(math.radians(2.0), rel=0.01)
    still = motion.blur_px(observed(0.2), 12.0)
    assert still == pytest.approx(math.radians(2.0) / 4000 * FOCAL_PX, rel=0.01)


def test_a_report_that_comes_again_is_no_standstill():
    motion = Motion(SETTINGS)
    for stamp in (0.0, 0.1, 0.1, 0.1):
        motion.take(observed(stamp, yaw_rad=0.1 * stamp))
    assert motion.rate_rps == pytest.approx(0.1, rel=0.01)


def test_without_a_gimbal_nothing_is_known_to_be_sharp():
    assert Motion(SETTINGS).blur_px(Observation(0.0, 1), 12.0) == math.inf


def test_the_shutter_is_what_the_camera_says_else_what_it_was_asked():
    assert shutter_s(None, SETTINGS) == pytest.approx(1 / 4000)
    assert shutter_s(CameraState(0.0, 0.0, 0.0, shutter_s=1 / 1000), SETTINGS) == 1 / 1000


def test_the_speed_leaves_room_for_gusts_and_for_the_gimbal():
    motion = Motion(SETTINGS)
    for shutter in (1 / 1600, 1 / 2000, 1 / 4000):
        speed = tracking_speed_mps(12.0, 6.0, shutter, SETTINGS)
        gusty = observed(0.0, (0.0, speed + 0.2, 0.0), shutter=shutter)
        turning_px = 0.02 * shutter * FOCAL_PX
        assert motion.blur_px(gusty, 11.2) + turning_px <= SETTINGS.camera.max_blur_px


def test_the_sight_is_a_unit_vector_up_by_the_pitch():
    sight = sight_w(GimbalState(0.0, math.pi / 2, math.radians(30.0)))
    assert sight == pytest.approx([0.0, math.cos(math.radians(30.0)), 0.5])
