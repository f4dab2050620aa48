import math

import numpy as np
import pytest

from perception.hub_prior import SurveyResult
from perception.side_votes import SideVotes
from perception.tower import Tower

TOWER = Tower(np.zeros(3), np.array([0.0, 0.0, 1.0]), 2.0, -0.01, None, 60.0, 0.1, 500)


def look(stamp_s, yaw_deg):
    normal = np.array([math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg)), 0.0])
    return SurveyResult(float(stamp_s), TOWER, np.array([0.0, 0.0, 80.0]), normal, 1.0, 3.0)


def voted(*looks, at_s=20.0):
    votes = SideVotes(180.0)
    for stamp_s, yaw_deg in looks:
        votes.add(look(stamp_s, yaw_deg))
    return votes.believed(at_s)


def test_one_look_is_believed_while_none_contradicts():
    assert voted() is None
    assert voted((1, 50.0)).stamp_s == 1.0


def test_the_newest_look_of_the_side_that_most_name_is_given():
    assert voted((1, 350.0), (2, 10.0), (3, 140.0)).stamp_s == 2.0


def test_looks_that_contradict_each_other_leave_the_side_unknown():
    assert voted((1, 0.0), (2, 140.0)) is None
    assert voted((1, 0.0), (2, 5.0), (3, 140.0), (4, 142.0)) is None


def test_a_nacelle_that_has_turned_is_believed_once_the_old_looks_are_outvoted_or_fade():
    before = [(k, 0.0) for k in range(4)]
    after = [(10 + k, 90.0) for k in range(8)]
    assert voted(*before, *after[:7]) is None
    assert voted(*before, *after).normal_w == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    assert voted(*before, *after[:2], at_s=185.0).stamp_s == 11.0
