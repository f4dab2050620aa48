from itertools import product

import pytest

from mission.flight.events import POLICY, Event, Reaction, arbitrate, worst


def test_every_event_has_a_policy_that_a_person_can_read():
    assert set(POLICY) == set(Event)
    assert all(len(policy.words) > 10 for policy in POLICY.values())


@pytest.mark.parametrize(("one", "other"), list(product(Event, Event)))
def test_the_worse_of_two_events_wins(one, other):
    expected = max(POLICY[one].reaction, POLICY[other].reaction)
    assert arbitrate([one, other]) is arbitrate([other, one]) is expected
    winner = worst([one, other])
    assert winner is not None
    assert POLICY[winner].reaction is expected


def test_nothing_active_asks_for_nothing():
    assert arbitrate([]) is Reaction.NONE
    assert worst([]) is None


@pytest.mark.parametrize("event", list(Event))
def test_the_pilot_overrules_everything(event):
    assert arbitrate([event, Event.PILOT_TOOK_OVER]) is Reaction.RELEASE
