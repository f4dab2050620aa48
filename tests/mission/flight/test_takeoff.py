"""The take-off is the autopilot's own, to the height that was asked for or another."""

from mission.flight.command import Phase
from mission.flight.observation import FlightMode
from tests.mission.flight.test_missions import mission


def test_an_autopilot_that_takes_off_to_a_height_of_its_own_is_flown_on():
    low_m = 4.0

    def hook(flight, observation):
        if flight.mode is FlightMode.TAKEOFF and flight.position[2] > low_m:
            flight.mode = FlightMode.HOLD
        return observation

    flight = mission(hook=hook)
    flown = flight.run(until=Phase.ASCEND, limit_s=40.0)
    assert flight.machine.phase is Phase.ASCEND
    assert flight.mode is FlightMode.OFFBOARD
    assert any("ended its climb at 4" in event.text for event in flown.events)


def test_a_climb_that_goes_on_is_waited_for():
    flight = mission()
    flown = flight.run(until=Phase.ASCEND, limit_s=40.0)
    assert flight.machine.phase is Phase.ASCEND
    assert not any("ended its climb" in event.text for event in flown.events)
