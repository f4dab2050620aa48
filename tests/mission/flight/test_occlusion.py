import numpy as np
import pytest

from config.presets import load_turbine
from mission.flight.occlusion import behind_tower
from mission.flight.rotor_model import MeasuredBlade, rotor_model

TURBINE = load_turbine("nrel-5mw")
HUB = np.array([0.0, -5.0, 90.0])
NAMES = (("A", (0.0, 0.0, -1.0)), ("B", (0.866, 0.0, 0.5)), ("C", (-0.866, 0.0, 0.5)))


@pytest.fixture(scope="module")
def model():
    """The rotor faces -y; the tower stands at x = y = 0."""
    blades = [MeasuredBlade(name, direction, 2.0) for name, direction in NAMES]
    return rotor_model(
        HUB, np.array([0.0, 1.0, 0.0]), blades, TURBINE, np.zeros(3), np.array([0.0, 0.0, 1.0])
    )


def hidden(model, eye, point):
    eyes, points = np.array([eye], np.float64), np.array([point], np.float64)
    return bool(behind_tower(eyes, points, model)[0])


def test_a_blade_before_the_tower_is_not_seen_from_behind_it(model):
    assert hidden(model, (0.0, 12.0, 60.0), (0.0, -5.0, 60.0))
    assert hidden(model, (3.0, 12.0, 60.0), (-1.0, -5.0, 58.0))


def test_past_the_tower_it_is(model):
    assert not hidden(model, (12.0, 12.0, 60.0), (0.0, -5.0, 60.0))
    assert not hidden(model, (0.0, -17.0, 60.0), (0.0, -5.0, 60.0)), "nothing between"
    assert not hidden(model, (0.0, -17.0, 60.0), (0.0, -4.0, 60.0)), "nor behind what is seen"


def test_above_its_top_the_tower_hides_nothing(model):
    assert not hidden(model, (0.0, 12.0, 110.0), (0.0, -5.0, 110.0))


def test_a_metre_that_cannot_be_flown_is_judged_without_a_fault(model):
    assert not hidden(model, (1e4, 1e4, 60.0), (0.0, -5.0, 60.0))
