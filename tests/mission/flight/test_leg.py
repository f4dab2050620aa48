"""What a leg says of where the vehicle is along it."""

import numpy as np
import pytest

from mission.flight.leg import Leg


@pytest.mark.parametrize("lean", [0.0, 0.3, -0.5])
def test_where_the_vehicle_is_for_a_metre_it_looks_at_that_metre(lean):
    grid = np.linspace(0.0, 40.0, 81)
    # Nearer and nearer along the span, on a blade that bends and whose middle moves along it.
    distance = np.interp(grid, [15.0, 21.0], [17.0, 12.0])
    centre = np.stack([0.01 * grid**2 / 4, 0.02 * grid, -0.01 * grid], axis=1)
    view = np.array([-np.sqrt(1 - lean**2), 0.0, lean])
    leg = Leg(
        "A", "LE", np.array([3.0, 4.0, 80.0]), np.array([0.0, 0.0, 1.0]), view, 0.0, grid,
        distance, 3.0, (1.0, 39.0), 40.0, centre, np.zeros((81, 3)),
    )  # fmt: skip
    for metre in (-2.0, 0.0, 14.0, 16.3, 18.0, 20.9, 22.0, 35.0, 40.0):
        assert leg.metre_of(leg.position(metre)) == pytest.approx(metre, abs=0.03)
