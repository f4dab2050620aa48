"""When a photo waits for the exposure, and what it is marked with when it waited in vain."""

from types import SimpleNamespace

import numpy as np
import pytest

from config.settings import Settings
from mission.flight.command import GimbalAim
from mission.flight.ledger import Photo
from mission.flight.observation import BladeTrack, ExposureState, GimbalState
from mission.flight.phases.shooter import Shooter

SETTINGS = Settings()
AIM = GimbalAim(0.0, 0.0)
LEG = SimpleNamespace(
    blade="A", side="PS", spacing_m=2.0, axis_w=np.array([1.0, 0.0, 0.0]), again=False
)


def shooter():
    motion = SimpleNamespace(blur_px=lambda *_: 0.0)
    return Shooter(LEG, (5.0,), motion)


def metered(stamp_s, grey=135.0, at_limit=False):
    return ExposureState(stamp_s, grey, 110 <= grey <= 160, 0.0, at_limit=at_limit)


def step(one, now_s, exposure):
    track = BladeTrack(
        now_s, "A", (0.0, 12.0, 0.0), (1.0, 0.0, 0.0), 12.0, 500.0, (0.0, 0.0, 0.0), 0.02
    )
    observation = SimpleNamespace(
        exposure=exposure, gimbal=GimbalState(now_s, 0.0, 0.0), blade=track
    )
    flight = SimpleNamespace(
        now_s=now_s, observation=observation, settings=SETTINGS,
        vehicle=SimpleNamespace(velocity_w=(0.0, 0.0, 0.0)),
        ledger=SimpleNamespace(
            ask=lambda leg, target, metre, now: Photo(1, leg, target, metre, now),
            settle=lambda *_: None,
        ),
    )  # fmt: skip
    return one.step(flight, 5.0, 12.0, AIM, np.zeros(3), np.zeros(3), 2.0)[0]


def test_two_frames_in_range_release_a_photo_and_one_does_not():
    one = shooter()
    assert step(one, 1.0, metered(0.95)) is None
    assert step(one, 1.05, metered(0.95)) is None
    photo = step(one, 1.1, metered(1.05))
    assert photo is not None
    assert photo.marks == ()


def test_a_frame_out_of_range_begins_the_count_anew():
    one = shooter()
    step(one, 1.0, metered(0.9))
    step(one, 1.1, metered(1.0, grey=200.0))
    assert step(one, 1.2, metered(1.1)) is None
    assert step(one, 1.3, metered(1.2)) is not None


@pytest.mark.parametrize("exposure", [None, metered(0.2), metered(1.4, grey=90.0)])
def test_without_a_right_exposure_it_is_taken_after_half_a_second_and_marked(exposure):
    one = shooter()
    assert step(one, 1.0, exposure) is None
    assert step(one, 1.45, exposure) is None
    photo = step(one, 1.55, exposure)
    assert photo is not None
    assert photo.marks == ("exposure",)


def test_at_the_cameras_limit_waiting_helps_nobody():
    photo = step(shooter(), 1.0, metered(0.95, grey=90.0, at_limit=True))
    assert photo is not None
    assert photo.marks == ("limit",)


def pace(one, now_s, metre, exposure):
    observation = SimpleNamespace(exposure=exposure, gimbal=None, blade=None)
    flight = SimpleNamespace(now_s=now_s, observation=observation, settings=SETTINGS)
    return one.step(flight, metre, 12.0, AIM, np.zeros(3), np.zeros(3), 2.0)[1]


def test_the_vehicle_slows_before_a_photo_that_will_have_to_wait():
    one = shooter()
    pace(one, 1.0, 3.0, metered(0.9))
    assert pace(one, 1.1, 4.2, metered(1.0)) == 1.0
    dark = metered(1.1, grey=60.0)
    assert pace(one, 1.2, 3.9, dark) == 1.0
    assert pace(one, 1.2, 4.4, dark) == pytest.approx(0.6)
