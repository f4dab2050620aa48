import math

import pytest

from drivers.autopilot_wire import Received


def test_a_message_is_taken_as_it_is_handed_over():
    message = Received.of("LOCAL_POSITION_NED", 1, '{"x": 2, "y": null, "q": [1, null]}', 5)
    assert message.number("x") == 2.0
    assert math.isnan(message.number("y"))
    assert message.numbers("q")[0] == 1.0
    assert message.integer("absent", 7) == 7


@pytest.mark.parametrize("fields", ["0", "[1]", "null", '"text"', "", "{"])
def test_fields_that_are_no_object_are_told(fields):
    with pytest.raises(ValueError):
        Received.of("HEARTBEAT", 1, fields, 5)
