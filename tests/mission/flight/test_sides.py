import math

import numpy as np
import pytest

from config.presets import load_turbine
from mission.flight.sides import blade_frame, side_view, turned

TURBINE = load_turbine("windpact-1.5")
DOWNWIND = np.array([0.0, 1.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])


def straight(pitch_deg):
    """Pitch that makes the section at half span stand at an angle: the catalogue's twist off."""
    twist = float(np.interp(0.5, TURBINE.blade.span, TURBINE.blade.twist_deg))
    return blade_frame("A", np.zeros(3), DOWNWIND, UP, pitch_deg - twist, TURBINE)


def test_operating_the_pressure_side_faces_upwind():
    frame = straight(0.0)
    assert side_view(frame, "PS", TURBINE) == pytest.approx(-DOWNWIND, abs=1e-9)
    assert side_view(frame, "SS", TURBINE) == pytest.approx(DOWNWIND, abs=1e-9)


def test_operating_the_leading_edge_points_where_the_rotor_turns():
    # Seen from upwind (looking north) a clockwise rotor moves its upper blade to the right, east.
    frame = straight(0.0)
    assert side_view(frame, "LE", TURBINE) == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)


def test_feathered_the_leading_edge_points_upwind_and_the_sides_face_sideways():
    frame = straight(90.0)
    assert side_view(frame, "LE", TURBINE) == pytest.approx(-DOWNWIND, abs=1e-9)
    assert side_view(frame, "TE", TURBINE) == pytest.approx(DOWNWIND, abs=1e-9)
    assert abs(side_view(frame, "PS", TURBINE) @ DOWNWIND) < 1e-9


def test_a_counter_clockwise_rotor_is_the_mirror_image():
    other = TURBINE.model_copy(update={"rotation": "counter-clockwise"})
    frame = blade_frame("A", np.zeros(3), DOWNWIND, UP, 0.0, other)
    assert side_view(frame, "LE", other)[0] < -0.9


def test_a_turned_view_stays_square_to_the_axis():
    frame = straight(30.0)
    view = turned(side_view(frame, "PS", TURBINE), frame.axis_w, math.radians(45))
    assert abs(view @ frame.axis_w) < 1e-9
    assert np.linalg.norm(view) == pytest.approx(1.0)


def test_without_a_pitch_there_are_no_sides():
    frame = blade_frame("A", np.zeros(3), DOWNWIND, UP, None, TURBINE)
    with pytest.raises(ValueError, match="no pitch"):
        side_view(frame, "PS", TURBINE)
