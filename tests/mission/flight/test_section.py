"""Where the middle of a blade's chord appears in a picture."""

import numpy as np
import pytest

from benchmarks.virtual_turbine import Truth, true_model
from config.presets import load_turbine
from mission.flight.section import Section
from mission.flight.sides import side_view, turned

TURBINE = load_turbine("nrel-1.72-103")
FRAME = true_model(Truth(pitch_deg=30.0), TURBINE).frames[0]
GRID = np.linspace(0.0, FRAME.length_m, 40)


@pytest.mark.parametrize("turn_deg", [-57, -30, 0, 45])
def test_both_ends_of_a_chord_seen_aslant_appear_as_far_from_where_the_camera_is_aimed(turn_deg):
    view = turned(side_view(FRAME, "PS", TURBINE), FRAME.axis_w, np.deg2rad(turn_deg))
    section, metre = Section(FRAME, TURBINE, GRID), 12
    across = section.across(view)
    axis = FRAME.root_w + GRID[metre] * FRAME.axis_w
    middle = axis + section.centre(view)[metre]
    eye = middle + 12.0 * view
    apparent = section.apparent(view, np.full(len(GRID), 12.0))[metre]
    # The chord's ends, by its twist: half a chord to both sides of its middle.
    shape, share = TURBINE.blade, GRID[metre] / FRAME.length_m
    chord = np.interp(share, shape.span, shape.chord_m)
    lead = FRAME.leading(
        FRAME.pitch_rad + np.radians(np.interp(share, shape.span, shape.twist_deg))
    )
    tangents = []
    for end in (0.5 * chord * lead, -0.5 * chord * lead):
        ray = middle + end - eye
        tangents.append(float(ray @ across) / float(ray @ -view))
    aimed = float((middle + apparent - eye) @ across) / 12.0
    assert aimed == pytest.approx(sum(tangents) / 2, abs=0.001)
