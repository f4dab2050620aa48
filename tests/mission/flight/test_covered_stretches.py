import pytest

from mission.flight.leg import Unseen
from mission.flight.report import covered_stretches


def test_overlapping_footprints_are_one_stretch():
    assert covered_stretches([(4, 8), (0, 5), (10, 12)], 33) == ((0, 8), (10, 12))


def test_footprints_end_where_the_blade_ends():
    assert covered_stretches([(-2, 2), (31, 35), (40, 44)], 33) == ((0.0, 2), (31, 33))


@pytest.mark.parametrize(
    ("gap", "left"),
    [
        ((3, 5), ((0, 3), (5, 10))),
        ((0, 4), ((4, 10),)),
        ((8, 20), ((0, 8),)),
        ((0, 33), ()),
        ((12, 20), ((0, 10),)),
    ],
)
def test_what_no_view_shows_is_not_counted(gap, left):
    assert covered_stretches([(0, 10)], 33, [Unseen(*gap, "tower")]) == left


def test_nothing_photographed_is_nothing_covered():
    assert covered_stretches([], 33, [Unseen(1, 2, "tower")]) == ()
