"""How photos that come back move the aim of those that follow."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from config.photos import Positioning
from mission.flight.observation import PhotoResult
from mission.flight.phases.centring import MOST_M, Centring

#: Seen from the south, a blade that hangs plumb: aside is east or west.
ASIDE = np.array([1.0, 0.0, 0.0])


def leg(*, blade="A", blind=True, view=(0.0, -1.0, 0.0), aside_m=0.0):
    """Return as much of a leg as centring looks at."""
    return SimpleNamespace(
        blade=blade, blind=blind, view_w=np.array(view), axis_w=np.array([0.0, 0.0, -1.0]),
        aside=lambda _metre: aside_m * ASIDE,
    )  # fmt: skip


RTK = Positioning(method="rtk")
GNSS = Positioning(method="gnss")


def fly(centring, off_m, *, photos=6, late=1, start_s=0.0, aside_m=0.0, unseen=True, firm=False):
    """Take photos three seconds apart, each judged ``late`` photos later; return what was shown.

    ``off_m``: how far east of its target the blade really is.
    """
    shown, waiting = [], []
    for number in range(photos):
        now_s = start_s + 3.0 * number
        judged = (waiting.pop(0),) if len(waiting) > late else ()
        centring.step(judged, now_s, unseen=unseen, firm=firm)
        centring.asked(number, 10.0 + number, now_s)
        beside = off_m - float(centring.value_w @ ASIDE) - aside_m
        shown.append(beside)
        waiting.append(PhotoResult(number, kept=True, beside_w=tuple(beside * ASIDE)))
    return shown


def begun(flown, positioning=RTK):
    """Return a centring that has begun a leg."""
    centring = Centring(positioning)
    centring.begin(flown, 0.0)
    return centring


def test_a_blade_beside_its_target_comes_to_the_middle_within_a_few_photos():
    shown = fly(begun(leg()), 0.45, late=0)
    assert shown[0] == pytest.approx(0.45)
    assert abs(shown[2]) < 0.15
    assert abs(shown[-1]) < 0.05


def test_a_blade_that_the_lidar_sees_is_centred_too_once_it_was_found():
    centring = begun(leg(blind=False))
    shown = fly(centring, 0.3, unseen=False, firm=True, photos=10)
    assert abs(shown[-1]) < 0.1


def test_a_blade_that_the_lidar_has_not_found_yet_is_not_learnt_from():
    centring = begun(leg(blind=False))
    fly(centring, 0.3, unseen=False, firm=False)
    assert centring.value_w == pytest.approx(np.zeros(3))


def test_seen_and_unseen_are_learnt_apart():
    centring = begun(leg(blind=False))
    fly(centring, 0.4, unseen=False, firm=True)
    assert centring.value_w[0] > 0.2
    centring.step((), 20.0, unseen=True, firm=False)
    assert centring.value_w == pytest.approx(np.zeros(3))


def test_results_that_come_late_do_not_make_it_swing():
    shown = fly(begun(leg()), 0.45, photos=20, late=3)
    assert min(shown) > -0.1
    assert max(np.abs(shown[-5:])) < 0.05


def test_a_picture_of_a_wide_blade_that_is_aimed_beside_its_middle_moves_nothing():
    centring = begun(leg(aside_m=1.2))
    fly(centring, 0.0, aside_m=1.2)
    assert centring.value_w == pytest.approx(np.zeros(3), abs=1e-6)


@pytest.mark.parametrize(
    "photo",
    [
        PhotoResult(0, kept=True),
        PhotoResult(7, kept=True, beside_w=(0.4, 0.0, 0.0)),
        PhotoResult(0, kept=True, beside_w=(1.4, 0.0, 0.0)),
        PhotoResult(0, kept=True, beside_w=(math.nan, 0.0, 0.0)),
        PhotoResult(0, kept=True, beside_w=(0.0, 0.2, 0.5)),
    ],
    ids=["no outline", "never asked for", "of something else", "no number", "not across"],
)
def test_what_does_not_tell_the_blades_middle_is_left_out(photo):
    centring = begun(leg())
    centring.asked(0, 10.0, 0.0)
    centring.step((photo,), 1.0, unseen=True, firm=False)
    assert centring.value_w == pytest.approx(np.zeros(3))


def test_the_aim_is_never_moved_by_more_than_a_metre():
    centring = begun(leg(), GNSS)
    fly(centring, 1.8, photos=20)
    assert np.linalg.norm(centring.value_w) == pytest.approx(MOST_M)


@pytest.mark.parametrize(
    ("following", "kept"),
    [
        (leg(blade="B"), True),
        (leg(blade="B", view=(0.0, 1.0, 0.0)), False),
        (leg(blind=False), False),
    ],
    ids=["from the same side", "from behind", "seen by the LiDAR"],
)
def test_what_was_learnt_is_kept_for_a_blade_that_is_seen_alike(following, kept):
    centring = begun(leg())
    fly(centring, 0.4)
    centring.begin(following, 20.0)
    assert bool(centring.value_w[0] > 0.2) is kept


def test_it_fades_while_nothing_is_photographed():
    centring = begun(leg())
    fly(centring, 0.4)
    centring.begin(leg(blade="B"), 200.0)
    centring.asked(9, 10.0, 200.0)
    none = PhotoResult(9, kept=True, beside_w=tuple(-centring.value_w))
    centring.step((none,), 201.0, unseen=True, firm=False)
    assert abs(centring.value_w[0]) < 0.05
