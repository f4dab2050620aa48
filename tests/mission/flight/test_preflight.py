"""What is waited for on the ground, and what is done about it."""

import dataclasses

import pytest

from mission.flight.command import Action, MissionState, Phase
from mission.flight.observation import FlightMode
from tests.mission.flight.test_missions import mission

UNFLOWN = (Phase.IDLE, Phase.PREFLIGHT)


def on_the_ground(mode, armable_in):
    """Return a flight of a vehicle that was left in a mode on the ground."""

    def hook(flight, observation):
        healthy = flight.mode in armable_in
        return dataclasses.replace(
            observation, vehicle=dataclasses.replace(observation.vehicle, healthy=healthy)
        )

    flight = mission(hook=hook)
    flight.mode = mode
    return flight


def actions(flight, limit_s):
    """Fly until the motors shall start, or for so long; return what was asked of the vehicle."""
    asked, begun_s, flown = [], flight.now_s, flight.run(limit_s=0.0)
    while flight.now_s - begun_s < limit_s and flight.machine.phase in UNFLOWN:
        asked.append(flight.one_tick(flown).command.action)
    return [action for action in asked if action is not None]


@pytest.mark.parametrize("mode", [FlightMode.OFFBOARD, FlightMode.LAND, FlightMode.RETURN])
def test_a_vehicle_left_in_a_mode_that_cannot_be_armed_is_asked_to_hold(mode):
    flight = on_the_ground(mode, armable_in={FlightMode.HOLD})
    assert actions(flight, 30.0) == [Action.HOLD, Action.ARM]
    assert flight.machine.phase is Phase.TAKEOFF


def test_a_pilots_mode_is_the_pilots():
    flight = on_the_ground(FlightMode.PILOT, armable_in=())
    assert actions(flight, 140.0) == []
    flight.run(limit_s=1.0)
    assert flight.machine.state is MissionState.REFUSED


def test_a_vehicle_that_cannot_be_armed_for_another_reason_is_not_asked_at_every_tick():
    flight = on_the_ground(FlightMode.OFFBOARD, armable_in=())
    assert 0 < actions(flight, 20.0).count(Action.HOLD) <= 5
