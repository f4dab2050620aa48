"""Stills that are not exposed as the live picture is."""

import random

import pytest

from mission.flight.command import SensingMode, SensingTask
from mission.flight.observation import ExposureState, Observation, PhotoResult
from mission.flight.still_offset import LEAST_STILLS, MOST_GREY, RECENT_STILLS, StillOffset

TASK = SensingTask(SensingMode.BLADE, 3)


def flown(apart, live=135.0):
    """A photo every 2 s, judged 1.5 s later; ``apart``: of each still from the live picture."""
    offset, due = StillOffset(), []
    for k in range(20 * (2 * len(apart) + 4)):
        now_s = 0.05 * k
        if k % 40 == 0 and k // 40 < len(apart):
            grey = None if apart[k // 40] is None else live + apart[k // 40]
            due.append((now_s + 1.5, PhotoResult(k, True, "", now_s + 0.07, grey)))
        photos = tuple(photo for at_s, photo in due if at_s <= now_s)
        due = [one for one in due if one[0] > now_s]
        exposure = ExposureState(now_s - 0.06, live, in_range=True, ev_wanted=0.0)
        offset.step(Observation(now_s, k, exposure=exposure, photos=photos))
    return offset


def test_stills_that_are_alike_leave_everything_as_it_is():
    offset = flown([random.Random(1).gauss(0, 3) for _ in range(8)])
    assert offset.grey == 0.0
    assert offset.told(TASK) is TASK


@pytest.mark.parametrize("apart", [35.0, -22.0])
def test_stills_that_stand_apart_are_told_to_perception(apart):
    noise = random.Random(2)
    offset = flown([apart + noise.gauss(0, 2) for _ in range(8)])
    assert offset.grey == pytest.approx(apart, abs=4)
    told = offset.told(TASK)
    assert told.still_offset_grey == offset.grey
    assert told.task_id == TASK.task_id
    assert ("brighter" if apart > 0 else "darker") in offset.words


def test_a_few_stills_are_not_enough():
    assert flown([15.0] * (LEAST_STILLS - 1)).grey == 0.0
    assert flown([15.0] * LEAST_STILLS).grey == 15.0


def test_stills_that_differ_now_so_and_now_otherwise_tell_nothing():
    assert flown([60.0, -30.0, 45.0, 5.0, 70.0, -50.0, 20.0, 90.0]).grey == 0.0


def test_a_pass_metered_beside_what_its_stills_show_is_gone_by_while_it_lasts():
    noise = random.Random(3)
    alike = [noise.gauss(2, 3) for _ in range(14)]
    beside = [55.0 + noise.gauss(0, 4) for _ in range(RECENT_STILLS)]
    assert flown([*alike, *beside[:-1]]).grey == 0.0
    assert flown([*alike, *beside]).grey == pytest.approx(55.0, abs=6.0)
    # It says nothing of the camera: the next pass begins as before.
    assert flown([*alike, *beside, None, None, None, None, None]).grey == 0.0
    assert flown([*alike, *beside, 1.0, -2.0]).grey == 0.0


def test_stills_in_which_no_blade_was_found_count_nothing():
    assert flown([None, 30.0, None, 30.0, None]).grey == 0.0


def test_a_still_without_a_live_picture_of_its_moment_counts_nothing():
    offset = StillOffset()
    for k in range(9):
        exposure = ExposureState(10.0 * k, 135.0, in_range=True, ev_wanted=0.0)
        photo = PhotoResult(k, True, "", 10.0 * k - 5.0, 180.0)
        offset.step(Observation(10.0 * k, k, exposure=exposure, photos=(photo,)))
    assert offset.grey == 0.0


def test_what_no_tone_curve_would_do_is_bounded():
    assert flown([115.0] * 6).grey == MOST_GREY
