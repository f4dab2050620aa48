"""When a wanted exposure is sent, to cameras whose exposures differ."""

import dataclasses

import pytest

from mission.flight.exposure_order import EV_AGAIN_S, ExposureOrder, ev_steps, exposure_words
from mission.flight.observation import CameraState, Observation

#: Thirds of a stop as most cameras list them: rounded to a tenth.
THIRDS = (-2.0, -1.7, -1.3, -1.0, -0.7, -0.3, 0.0, 0.3, 0.7, 1.0, 1.3, 1.7, 2.0)
STEPS = CameraState(0.0, 0.0, 0.0, min_ev=-1.0, max_ev=1.0, step_ev=0.5)
LISTED = dataclasses.replace(STEPS, min_ev=-2.0, max_ev=2.0, step_ev=0.3, evs=THIRDS)


def seen(camera, now_s=0.0):
    return Observation(now_s, 1, None, camera=camera)


@pytest.mark.parametrize(("wanted", "sent"), [(0.3, 0.5), (0.2, 0.0), (9.0, 1.0), (-9.0, -1.0)])
def test_the_nearest_step_within_the_limits_is_sent(wanted, sent):
    assert ExposureOrder().due(wanted, seen(STEPS)) == pytest.approx(sent)


@pytest.mark.parametrize(("wanted", "sent"), [(0.62, 0.7), (1.35, 1.3), (1.9, 2.0), (5.0, 2.0)])
def test_a_camera_that_lists_its_evs_is_asked_for_one_of_them(wanted, sent):
    assert ExposureOrder().due(wanted, seen(LISTED)) == sent
    assert ev_steps(LISTED).evs == THIRDS


def test_an_ev_is_sent_once_and_again_only_where_the_camera_did_not_take_it():
    order = ExposureOrder()
    assert order.due(0.7, seen(LISTED)) == 0.7
    assert order.due(0.7, seen(LISTED, 0.5 * EV_AGAIN_S)) is None
    assert order.due(0.7, seen(LISTED, 1.1 * EV_AGAIN_S)) == 0.7
    taken = dataclasses.replace(LISTED, ev=0.7)
    assert order.due(0.7, seen(taken, 9.0)) is None


@pytest.mark.parametrize("camera", [None, dataclasses.replace(STEPS, ev=None)])
def test_a_camera_without_ev_is_asked_nothing(camera):
    assert ExposureOrder().due(1.0, seen(camera)) is None
    assert ExposureOrder().due(None, seen(STEPS)) is None


def test_how_a_camera_is_exposed_is_said_plainly():
    assert exposure_words(STEPS) == "exposure is set, -1.0 to +1.0 EV, 5 values"
    biased = exposure_words(dataclasses.replace(LISTED, manual=False))
    assert biased == "exposure is a bias of the camera's own automatic, -2.0 to +2.0 EV, 13 values"
    for camera in (None, dataclasses.replace(STEPS, ev=None)):
        assert "no exposure that could be set" in exposure_words(camera)
